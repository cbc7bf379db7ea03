"""`inkloop identify`: an ink file, tables and a picture from logged prints, or from experiments on a plant."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any

import tomlkit
from rich.progress import Progress
from rich.table import Table

from inkloop.component import Ink
from inkloop.components.catalog import DEPOSITION_MODELS, kinds
from inkloop.errors import near, nearest
from inkloop.report.terminal import Terminal
from inkloop.results.result import RESULT_FILE, Result
from inkloop.scenario.file import Scenario
from inkloop.tables.schema import Inks
from inkloop.units import UM_PER_M
from inkloop_lab.identify.candidates import words
from inkloop_lab.identify.experiments import Plan, perform, plant_scenario
from inkloop_lab.identify.identification import Identification, identify
from inkloop_lab.identify.ink_writer import write_ink
from inkloop_lab.identify.log_folder import DESCRIPTION, is_log, read_log
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, read_run
from inkloop_lab.identify.volume_area_coefficients import NAMES


def run(options: argparse.Namespace, overrides: Mapping[str, Any], console: Terminal) -> int:
    """Identify, show and write; returns an exit code. Raises IdentificationError and those of reading and printing."""
    out: Path = options.out or Path(f"{Path(options.sources[0]).resolve().stem}-ink.toml")
    if out.exists():
        raise IdentificationError(f"{out}: is there already and is not overwritten; name another --out")
    _check(options)
    with _progress(console) as show:
        records, nominal = _records(options, overrides, show)
        noise = None if options.noise_um is None else options.noise_um / UM_PER_M
        found = identify(records, nominal, noise, options.seed, show, options.reach)
    for table in tables(found):
        console.print(table)
    for note in (*(f"{place}; this is corrected" for place in found.displaced), *found.notes):
        console.sentence(f"note: {note}")
    write_ink(found, out, date.today())
    pictures: list[Path] = []
    if options.pictures:
        from inkloop_lab.identify.picture import save

        pictures = save(found, out.with_suffix(""), options.pictures)
    console.sentence(f"wrote {' and '.join(map(str, (out, *pictures)))}")
    console.result(file=out, pictures=pictures, scans=found.displaced, notes=list(found.notes))
    return 0


def tables(found: Identification) -> Iterator[Table]:
    """The results as a table for the screen."""
    yield _heights(found)
    if found.volume_area is not None:
        yield _volume_area(found)
    yield _comparison(found)


def _check(options: argparse.Namespace) -> None:
    limits = {"samples": (0, 2000), "layers": (1, 200), "side": (12, 500)}
    errors = [
        f"--{name} is {getattr(options, name)}; expected {low} to {high}"
        for name, (low, high) in limits.items()
        if not low <= getattr(options, name) <= high
    ]
    if options.runs is not None and options.runs.exists() and (options.runs.is_file() or any(options.runs.iterdir())):
        errors.append(f"--runs {options.runs}: is there already and not empty; name another, nothing is overwritten")
    if options.noise_um is not None and not 0.0 <= options.noise_um < 1e6:
        errors.append(f"--noise-um is {options.noise_um}; expected at least 0")
    if errors:
        raise IdentificationError("\n".join(errors))


def _records(
    options: argparse.Namespace, overrides: Mapping[str, Any], show: _Show
) -> tuple[list[PrintRecord], Sequence[Ink]]:
    """The prints, and the nominal ink of their scenario."""
    folders = [Path(source) for source in options.sources if Path(source).is_dir()]
    if len(folders) == len(options.sources):
        return [_read(folder) for folder in folders], _nominal(folders[0])
    if len(options.sources) > 1:
        others = ", ".join(source for source in options.sources if not Path(source).is_dir())
        raise IdentificationError(f"{others}: no folder of a print; name folders, or one plant to experiment on")
    source = options.sources[0]
    if source.endswith(".toml"):
        scenario = Scenario.load(source, overrides)
    elif source.endswith(".fmu") or ":" in source or source in kinds():
        noise = 0.3 if options.noise_um is None else options.noise_um
        scenario = plant_scenario(source, noise, overrides)
    else:
        known = nearest(source, kinds(), DEPOSITION_MODELS)
        raise IdentificationError(f"{source}: is no folder, no .toml or .fmu file and no kind of printer; {known}")
    plan = Plan(options.samples, options.layers, options.side, options.seed)
    records = perform(scenario, plan, options.runs, lambda done, total: show("printing experiments", done, total))
    return records, scenario.job().inks


def _read(folder: Path) -> PrintRecord:
    if is_log(folder):
        return read_log(folder)
    if (folder / RESULT_FILE).is_file():
        return read_run(folder)
    close = near(DESCRIPTION, [path.name for path in folder.glob("*.toml")])
    known = "name a folder that `inkloop run` has made, or that holds a logged print"
    advice = f"did you mean {close[0]}?" if close else known
    raise IdentificationError(
        f"{folder}: holds neither {DESCRIPTION} of a logged print nor {RESULT_FILE} of a run; {advice}"
    )


def _nominal(folder: Path) -> Sequence[Ink]:
    """The inks of a run's scenario, else those of Lu et al."""
    if not (folder / RESULT_FILE).is_file():
        return (Ink(),)
    inks = Inks.model_validate(tomlkit.parse(Result.load(folder).scenario_text).unwrap().get("ink", {}))
    return (inks.a.ink,) if inks.b is None else (inks.a.ink, inks.b.ink)


def _heights(found: Identification) -> Table:
    table = Table(
        title="height that a droplet adds [µm], with 95 % intervals",
        caption=f"noise of a reading {found.noise_std * UM_PER_M:.3g} µm; {found.ink.used} growths; droplets "
        f"vary by {found.ink.droplet_std:.1%}, with all that the model does not explain",
    )
    for heading in ("method", "h1", "h2", "h3"):
        table.add_column(heading, justify="left" if heading == "method" else "right")
    if found.protocol is not None:
        counts = ", ".join(f"{count} {name}" for name, count in found.protocol.counts.items())
        table.add_row(f"droplet protocol ({counts})", *_intervals(found.protocol.heights, found.protocol.half_widths))
    for material, heights, widths in zip("AB", found.ink.heights, found.ink.half_widths, strict=False):
        name = "regression over layers" + (f", material {material}" if len(found.ink.heights) > 1 else "")
        table.add_row(name, *_intervals(heights, widths))
    return table


def _intervals(values: Sequence[float], widths: Sequence[float]) -> list[str]:
    return [f"{value * UM_PER_M:.3f} +- {width * UM_PER_M:.3f}" for value, width in zip(values, widths, strict=True)]


def _volume_area(found: Identification) -> Table:
    assert found.volume_area is not None
    estimate = found.volume_area
    known = NAMES if estimate.area_known else NAMES[:2]
    gains = ", ".join(
        f"{name} {estimate.coefficients[name] / UM_PER_M:.4f} +- {estimate.half_widths[name] / UM_PER_M:.4f}"
        for name in known
    )
    areas = "" if estimate.area_known else "; no area was measured: ma_plus and ma_minus are the paper's"
    table = Table(
        title="Wu and Chiu's coefficients by (17), and their error (21) by prior drops",
        caption=f"c {estimate.coefficients['height_scale'] * UM_PER_M:.3f} µm; {gains} per µm{areas}",
    )
    table.add_column("prior drops")
    for prior in estimate.rms:
        table.add_column(prior, justify="right")
    table.add_row("samples", *(str(estimate.counts[prior]) for prior in estimate.rms))
    table.add_row("error of the mean", *(_share(rms) for rms, _ in estimate.rms.values()))
    table.add_row("its spread over groups of 3", *(_share(spread) for _, spread in estimate.rms.values()))
    return table


def _share(value: float) -> str:
    """A share in percent; "-" for a share of nothing."""
    return f"{value:.1%}" if math.isfinite(value) else "-"


def _comparison(found: Identification) -> Table:
    floor = 2.0**0.5 * found.noise_std * UM_PER_M
    table = Table(
        title="one step ahead, cells that the fit had not seen",
        caption=f"rms of scan minus prediction; the noise of two scans alone is {floor:.3g} µm; (21) is "
        "relative to the measured height",
    )
    table.add_column("model")
    table.add_column("rms [µm]", justify="right")
    table.add_column("(21)", justify="right")
    table.add_column("fitted to everything")
    for one in found.comparisons:
        if one.score is not None and one.model is not None:
            table.add_row(one.name, f"{one.score.rms * UM_PER_M:.3f}", _share(one.score.relative), words(one.model))
        else:
            table.add_row(one.name, "-", "-", "")
    return table


class _Show:
    """Shows the present work, steps done and the number of steps."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task = progress.add_task("reading", total=None)

    def __call__(self, name: str, done: int, total: int) -> None:
        self._progress.update(self._task, description=name, completed=done, total=total)


@contextmanager
def _progress(console: Terminal) -> Iterator[_Show]:
    with console.progress() as progress:
        yield _Show(progress)
