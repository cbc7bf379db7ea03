"""Print the part of a scenario, and its comparison runs, into a run folder."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from rich.progress import Progress, TaskID

from inkloop.components import devices
from inkloop.errors import ResultError
from inkloop.files import RUNS, reason_of
from inkloop.master.interrupt import advised, deferred
from inkloop.master.pacing import sentence
from inkloop.printing.advice import advice_on
from inkloop.printing.on_devices import log_devices
from inkloop.printing.print import Print, check_first_layer
from inkloop.report import PNG
from inkloop.report.terminal import Terminal, decimals
from inkloop.results.checkpoint import remove_layers
from inkloop.results.lock import LOCK_FILE, sole_writer
from inkloop.results.made_folder import made_folder
from inkloop.results.recorder import LayerRow
from inkloop.results.result import (
    COMPARE_FOLDER,
    RUN_FILE,
    SCENARIO_FILE,
    STOPPED,
    UNFINISHED,
    Result,
    is_unchanged,
    read_record,
)
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from
from inkloop.units import MS_PER_S, UM_PER_M

__all__ = ["INTERRUPTED", "new_run_folder", "origin_of", "print_part"]

INTERRUPTED = 130  # exit code of a command that Ctrl-C ended
STOPPED_PRINT = 4  # ... of one whose print was stopped, as the scans do not show what was printed


def run(
    scenario: Scenario, out: Path | None, console: Terminal, *, compare: bool = True, pictures: Sequence[str] = (PNG,)
) -> int:
    """Print, compare, save and show; returns the exit code of the command. An interrupted run keeps its layers.

    pictures: their formats, none without pictures.
    """
    folder = checked_run_folder(scenario, out, Path(scenario.source).stem)
    notices = [f"{folder}: {scenario.footprint}", *(f"warning: {warning}" for warning in scenario.warnings)]
    with advised(partial(advice_on, folder)):
        return _print_all(scenario, folder, console, compare, pictures, notices)


def checked_run_folder(scenario: Scenario, out: Path | None, name: str) -> Path:
    """The folder of `new_run_folder`, on a disk that can hold the run. Raises ResultError."""
    scenario.footprint.check_disk(out or RUNS)
    return new_run_folder(out, name)


def resume(
    scenario: Scenario,
    folder: Path,
    console: Terminal,
    *,
    pictures: Sequence[str] = (PNG,),
    layer_is: str | None = None,
) -> int:
    """Resume a run and its comparison runs after the last layer on disk; returns the exit code as `run` does.

    scenario: that of `scenario_of_run`; layer_is: what a person has seen of the open layer of a mapped rig, "printed",
    "blank" or "unknown". Raises ResultError if the folder cannot be resumed, ComponentError.
    """
    record = read_record(folder)
    if not is_unchanged(folder, record):
        raise ResultError(f"{folder / SCENARIO_FILE}: was changed since the run began; restore it, or run it again")
    if record.get("part_sha256") != scenario.part_sha256:
        raise ResultError(
            f"{folder}: the files of its part were changed since the run began; restore them, or run it again"
        )
    places = [place for place, _ in _runs(scenario, folder, record["compare"])]
    finished = [place for place in places if _is_finished(place)]
    for place in finished:
        remove_layers(place)  # there still if it was stopped between saving and this
    if finished == places:
        from inkloop.report import run_report

        console.sentence(
            f"{folder}: the run is finished ({record['stop_reason']}), nothing is changed; "
            f"`inkloop report {folder}` shows it"
        )
        if console.as_json:
            console.result(**run_report.record(folder))
        return 0
    if layer_is is not None:
        with sole_writer(folder):
            devices.settle_layer(next(place for place in places if place not in finished), layer_is)
    with advised(partial(advice_on, folder)):
        return _print_all(scenario, folder, console, record["compare"], pictures)


def origin_of(scenario: Scenario, *, compare: bool) -> dict[str, Any]:
    """Origin of a run, noted for resuming it."""
    source = str(Path(scenario.source).resolve())
    return {"scenario_file": source, "compare": compare, "part_sha256": scenario.part_sha256}


def _scenario_file(folder: Path) -> Path:
    """The file that the run in `folder` was started from. Raises ResultError."""
    record = read_record(folder)
    if "scenario_file" not in record:
        raise ResultError(f"{folder}: run.json names no scenario file: it kept no state to resume from; run it again")
    return Path(record["scenario_file"])


@contextmanager
def scenario_of_run(folder: Path, overrides: Mapping[str, Any] | None = None) -> Iterator[Scenario]:
    """The scenario as the run in `folder` began it; its classes are found. Raises ResultError, ScenarioError."""
    source = _scenario_file(folder)
    with classes_from(source.parent):
        yield Scenario.load(folder / SCENARIO_FILE, overrides, source=source)


def print_part(
    scenario: Scenario,
    progress: Progress | None = None,
    folder: Path | None = None,
    notes: Mapping[str, Any] | None = None,
) -> Result:
    """One print with its progress shown, from the start surface or the layers in `folder` to its end; see `Print`.

    Raises ComponentError, also where nothing was printed for an alpha that is too small.
    """
    bar = _LayerBar(progress, scenario.tables.label) if progress else None
    result = Print(scenario, folder, on_layer=bar, notes=notes).run()
    if bar:
        bar.finish()
    check_first_layer(scenario, result)
    return result


def _print_all(
    scenario: Scenario,
    folder: Path,
    console: Terminal,
    compare: bool,
    pictures: Sequence[str],
    notices: Sequence[str] = (),
) -> int:
    """Print the unfinished runs of a scenario in `folder`, and show all of them.

    notices: sentences to show before the first one.
    """
    from inkloop.report import run_report
    from inkloop.report.remarks import STOP_TITLE, ending, remarks

    gc.freeze()  # the imported objects stay: no collection has to search them
    notes = origin_of(scenario, compare=compare)
    is_interrupted, printed = False, dict[Path, Result]()
    with sole_writer(folder), deferred() as interrupted, console.progress("figures", "solve") as progress:
        for place, variant in _runs(scenario, folder, compare):
            if _is_finished(place):
                continue
            with _alone(place, folder), log_devices(variant, console, place):
                for notice in notices if place == folder else ():
                    console.sentence(notice)
                Result.begin(place, variant.text, notes)
                result = printed[place] = print_part(variant, progress, place, notes)
            if "real_time" in result.run:
                console.sentence(f"{result.run['label']}: {sentence(result.run['real_time'])}")
            for remark in remarks(result):
                console.sentence(f"{result.run['label']}: {remark}")
            is_interrupted = interrupted() or result.stop_reason == "interrupted"
            if is_interrupted:
                break
    console.print(run_report.write(folder, pictures, printed))
    reason = "interrupted" if is_interrupted else read_record(folder)["stop_reason"]
    written = "table, pictures and result.nc" if pictures else "table and result.nc"
    console.sentence(f"{reason}: {written} are in {folder}/")
    if is_interrupted:
        console.sentence(_advice(result, f"continue with `inkloop resume {folder}`"))
    is_stopped = reason == STOPPED
    if is_stopped:
        main = printed.get(folder) or Result.load(folder)
        console.sentence(f"{STOP_TITLE}:")
        console.sentence(ending(main))
        console.sentence(_advice(main, f"when you have looked at it, continue with `inkloop resume {folder}`"))
    if console.as_json:
        console.result(**run_report.record(folder, printed))
    return INTERRUPTED if is_interrupted else STOPPED_PRINT if is_stopped else 0


def _advice(result: Result, advice: str) -> str:
    """Advice to resume a run, or why it cannot be resumed."""
    refusal = result.run.get("not_resumable")
    return f"cannot be resumed: {refusal}" if refusal else advice


def _alone(place: Path, folder: Path) -> AbstractContextManager[None]:
    """Locks a comparison run too; the lock on `folder`, which holds it, is taken already."""
    return nullcontext() if place == folder else sole_writer(place)


def _is_finished(place: Path) -> bool:
    return (place / RUN_FILE).is_file() and read_record(place).get("stop_reason") not in UNFINISHED


def new_run_folder(out: Path | None, name: str) -> Path:
    """The folder to write to: `out`, which must be new or empty, or the first free of runs/NAME, runs/NAME-2, ..."""
    if out is not None:
        if out.exists() and (not out.is_dir() or any(path.name != LOCK_FILE for path in out.iterdir())):
            found = made_folder(out) or "is there already and not empty"
            raise ResultError(f"{out}: {found}; name another --out, nothing is overwritten")
        return out
    base = RUNS / name
    candidates = (base if n == 1 else base.with_name(f"{name}-{n}") for n in range(1, 1_000_000))
    return next(candidate for candidate in candidates if _is_claimed(candidate))


def _is_claimed(folder: Path) -> bool:
    """Make a folder; False if it exists. Atomic: only one caller succeeds."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        return False
    except OSError as error:
        raise ResultError(f"{folder}: the run cannot be written there: {reason_of(error)}") from error
    return True


class _LayerBar:
    """Shows each finished layer: its number, the errors over the part, and the time of its plan.

    The bar follows the height that is built, since a closed loop prints more layers than a nominal ink would need.
    """

    def __init__(self, progress: Progress, label: str) -> None:
        self._progress, self._begin = progress, 0.0
        self._task: TaskID = progress.add_task(label, total=1.0, figures="", solve="")

    def __call__(self, row: LayerRow) -> None:
        self._begin = self._begin or row.mean_error
        mean, std = decimals(row.mean_error * UM_PER_M), decimals(row.std * UM_PER_M)
        figures = f"layer {row.layer}: mean error {mean}, std {std} µm"
        solve = f"plan {row.scalars['solve_time'] * MS_PER_S:.1f} ms" if row.scalars.get("solve_time") else ""
        built = 1.0 - row.mean_error / self._begin if self._begin > 0.0 else 1.0
        self._progress.update(self._task, completed=min(max(built, 0.0), 1.0), figures=figures, solve=solve)

    def finish(self) -> None:
        """Ends the bar after the last layer."""
        self._progress.update(self._task, completed=1.0)


def _runs(scenario: Scenario, folder: Path, compare: bool) -> Iterator[tuple[Path, Scenario]]:
    yield folder, scenario
    for name in scenario.tables.compare if compare else ():
        yield folder / COMPARE_FOLDER / re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-"), scenario.variant(name)
