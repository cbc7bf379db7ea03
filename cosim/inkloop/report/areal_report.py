"""`inkloop metrology`: areal parameters of a surface."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from inkloop.component import BoolMap
from inkloop.errors import HeightMapError
from inkloop.metrology import map_file
from inkloop.metrology.areal import LENGTHS, NAMES, areal, values
from inkloop.metrology.height_map import HeightMap
from inkloop.report.terminal import Terminal, number_table
from inkloop.units import M_PER_UM, UM_PER_M


def show(map_: HeightMap, part: BoolMap | None, options: argparse.Namespace, console: Terminal) -> int:
    """Print the parameters over the cells that `--mask` chooses; returns the exit code. Raises HeightMapError.

    part: cells of the part where the map is of a run, which is the default there.
    """
    name = options.mask or ("all" if part is None else "part")
    found = areal(map_, _mask(map_, part, name), options.f_operation)
    shown = {symbol: value * (UM_PER_M if symbol in LENGTHS else 1.0) for symbol, value in values(found).items()}
    missing = f", {found.missing} more without a height" if found.missing else ""
    table = number_table(
        "parameter of ISO 25178-2",
        "value",
        title=map_.source,
        caption=f"{found.cells} cells{missing}; mask: {name}; taken off: {options.f_operation}; no filter",
    )
    for symbol, value in shown.items():
        table.add_row(f"{symbol}, {NAMES[symbol]}{' [µm]' if symbol in LENGTHS else ''}", f"{value:.6g}")
    console.print(table)
    by_key = {f"{symbol}_um" if symbol in LENGTHS else symbol: value for symbol, value in shown.items()}
    console.result(
        source=map_.source,
        mask=name,
        f_operation=options.f_operation,
        cells=found.cells,
        cells_without_height=found.missing,
        **by_key,
    )
    return 0


def read(options: argparse.Namespace) -> HeightMap:
    """The map of a file, with the unit and the pixel size of the command line. Raises HeightMapError."""
    pixel = None if options.pixel_um is None else options.pixel_um * M_PER_UM
    return map_file.read(options.source, unit=options.unit, pixel=pixel)


def _mask(map_: HeightMap, part: BoolMap | None, name: str) -> BoolMap | None:
    """The cells of "all", "part", or an NPY file of the map's shape, true or 1 where a cell counts."""
    if name == "all":
        return None
    if name == "part":
        if part is None:
            raise HeightMapError(f"{map_.source}: --mask part: only a run knows its part; name an NPY file or all")
        return part
    try:
        stored = np.load(Path(name), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise HeightMapError(f"{name}: is no mask that can be read; expected all, part or an NPY file") from error
    if not isinstance(stored, np.ndarray) or stored.dtype.kind not in "biu":
        raise HeightMapError(f"{name}: holds no mask; expected an array of booleans or whole numbers")
    return np.asarray(stored != 0, np.bool_)
