"""`inkloop metrology`: the parameters of a surface as a table and as plain values."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from inkloop.component import BoolMap
from inkloop.errors import HeightMapError
from inkloop.files import reason_of, regular
from inkloop.metrology import map_file
from inkloop.metrology.evaluation.definitions import DEFINITIONS, Group, Treatment
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Found
from inkloop.metrology.evaluation.table import Parameter, found, found_on_profiles, rows
from inkloop.metrology.height_map import HeightMap
from inkloop.report.terminal import Terminal, number_table
from inkloop.results.result import Result
from inkloop.results.surface import parameters_of
from inkloop.units import M_PER_UM

GROUPS: tuple[Group, ...] = ("areal", "form", "volume")


def show(subject: Subject, mask: str, options: argparse.Namespace, console: Terminal) -> int:
    """Print the parameters of a surface; returns the exit code: 1 where each of them was refused.

    mask: the name of the cells that count.
    """
    treatment, profiles = treatment_of(options), None
    if options.profile is None:
        values: Found = {
            symbol: value for group in GROUPS for symbol, value in found(subject, group, treatment).items()
        }
    else:
        values, profiles = found_on_profiles(subject, options.profile, treatment)
    parameters = rows(values, subject.applicable)
    used = subject.cells & subject.map_.valid
    missing = int(subject.cells.sum() - used.sum())
    lacking = f", {missing} more without a height" if missing else ""
    console.sentence(f"{subject.map_.source}: {subject.map_}")
    with_value = [parameter for parameter in parameters if not parameter.reason]
    for symbols, reason in reasons(parameters):
        console.sentence(f"{reason}: no {symbols if with_value else 'parameter'}")
    if with_value:
        groups = dict.fromkeys(DEFINITIONS[parameter.symbol].group for parameter in with_value)
        steps = [f"{group}: {treatment.of(group)}" for group in groups] + ([str(profiles)] if profiles else [])
        caption = f"{used.sum()} cells{lacking}; mask: {mask}; {' | '.join(steps)}"
        table = number_table("parameter", "value", title="Surface", caption=caption)
        for parameter in with_value:
            table.add_row(_label(parameter), _value(parameter))
        console.print(table)
    console.result(
        source=subject.map_.source,
        surface=str(subject.map_),
        mask=mask,
        f_operation=options.f_operation,
        s_filter_um=options.s_filter_um,
        l_filter_um=options.l_filter_um,
        filter_order=options.filter_order,
        missing=options.missing,
        cells=int(used.sum()),
        cells_without_height=missing,
        **({"profiles": str(profiles)} if profiles else {}),
        **{parameter.key: parameter.shown for parameter in parameters},
        refused={parameter.symbol: parameter.reason for parameter in parameters if parameter.reason},
    )
    return int(not with_value)


def table_of_runs(runs: Mapping[str, Result]) -> Table | None:
    """The parameters that `[metrology]` asked for, a column for each run; None where no run holds any."""
    columns = {name: parameters_of(result.dataset) for name, result in runs.items()}
    name = next((name for name, column in columns.items() if column), None)
    if name is None:
        return None
    first, dataset = columns[name], runs[name].dataset
    treatment = " | ".join(dict.fromkeys(str(dataset[each.symbol].attrs["treatment"]) for each in first))
    table = number_table(
        "parameter of the surface", *columns, title="Surface", caption=f"last layer, over the part; {treatment}"
    )
    for k, parameter in enumerate(first):
        table.add_row(_label(parameter), *(_value(column[k]) if column else "-" for column in columns.values()))
    return table


def _label(parameter: Parameter) -> str:
    """Symbols of ISO first; the symbol of a form is its name."""
    unit = f" [{parameter.printed_unit}]" if parameter.printed_unit else ""
    of_iso = DEFINITIONS[parameter.symbol].group in ("areal", "profile")
    return f"{parameter.symbol}, {parameter.name}{unit}" if of_iso else parameter.name + unit


def _value(parameter: Parameter) -> str:
    return "-" if parameter.reason else f"{parameter.shown:.6g}"


def reasons(parameters: Sequence[Parameter]) -> list[tuple[str, str]]:
    """Symbols that were refused, and why; those with the same reason together."""
    groups: dict[str, list[str]] = {}
    for parameter in parameters:
        if parameter.reason:
            groups.setdefault(parameter.reason, []).append(parameter.symbol)
    return [(", ".join(symbols), reason) for reason, symbols in groups.items()]


def treatment_of(options: argparse.Namespace) -> Treatment:
    """Filters and F-operation of the command line. Raises HeightMapError for numbers beyond their limits."""
    cutoffs = {}
    for name in ("s_filter", "l_filter"):
        um = getattr(options, f"{name}_um")
        if um is not None and not 0.0 < um < float("inf"):
            raise HeightMapError(f"--{name.replace('_', '-')}-um is {um:g}; expected a length above 0")
        cutoffs[name] = None if um is None else um * M_PER_UM
    if not 0.0 <= options.missing <= 1.0:
        raise HeightMapError(f"--missing is {options.missing:g}; expected a share from 0 to 1")
    return Treatment(options.f_operation, filter_order=options.filter_order, missing_max=options.missing, **cutoffs)


def read(options: argparse.Namespace) -> HeightMap:
    """The map of a file, with the options of the command line. Raises HeightMapError."""
    pixel = None if options.pixel_um is None else options.pixel_um * M_PER_UM
    return map_file.read(
        options.source,
        unit=options.unit,
        pixel=pixel,
        scale=options.count_scale,
        invalid_value=options.invalid_value,
        channel=options.channel,
        profile=options.profile is not None,
    )


def mask_of(map_: HeightMap, part: BoolMap | None, name: str) -> BoolMap | None:
    """The cells of "all", "part", or an NPY file of the map's shape, true or 1 where a cell counts.

    Raises HeightMapError.
    """
    if name == "all":
        return None
    if name == "part":
        if part is None:
            raise HeightMapError(f"{map_.source}: --mask part: only a run knows its part; name an NPY file or all")
        return part
    try:
        stored = np.load(regular(Path(name)), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        reason = f" ({reason_of(error)})" if isinstance(error, OSError) else ""
        raise HeightMapError(
            f"{name}: is no mask that can be read{reason}; expected all, part or an NPY file"
        ) from error
    if not isinstance(stored, np.ndarray) or stored.dtype.kind not in "biu":
        raise HeightMapError(f"{name}: holds no mask; expected an array of booleans or whole numbers")
    return np.asarray(stored != 0, np.bool_)
