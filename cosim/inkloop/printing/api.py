"""Print and read from Python: `inkloop.run` and `inkloop.load`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from inkloop.errors import require
from inkloop.printing.on_devices import log_devices
from inkloop.printing.run import checked_run_folder, origin_of, print_part
from inkloop.report import picture_formats
from inkloop.report.terminal import Terminal
from inkloop.results.lock import sole_writer
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from


def run(
    scenario: Scenario | Path | str,
    overrides: Mapping[str, Any] | None = None,
    *,
    out: Path | str | None = None,
    pictures: Sequence[str] = (),
    **keys: Any,
) -> Result:
    """Print a scenario and return its result.

    scenario: a .toml or .ssp file, or a loaded Scenario; overrides and keys: values that replace those of the file, see
    `load`; out: new folder for the run (None: the result stays in memory). In the folder each layer is saved as soon as
    it is printed, so that `inkloop resume` can continue. pictures: formats ("png", "svg", "pdf") of the pictures to
    write there with the table; without any, `inkloop report` writes them later. Comparison runs of the scenario are
    not printed. Ctrl-C ends the print after a layer: `stop_reason` is then "interrupted".

    Raises ScenarioError for errors of the scenario, ComponentError where a component fails, ResultError where the
    folder exists or cannot be written, InkloopError for pictures without Matplotlib.
    """
    loaded = _scenario(scenario, {**(overrides or {}), **keys})
    source, formats = Path(loaded.source), picture_formats(pictures)
    with classes_from(source.parent):
        if out is None:
            if formats:
                raise ValueError(f"pictures = {pictures!r} have no folder to be written to; give out")
            return print_part(loaded)
        if formats:
            require("matplotlib", "a picture")
        folder = checked_run_folder(loaded, Path(out), source.stem)
        with sole_writer(folder), log_devices(loaded, Terminal(quiet=True), folder):
            notes = origin_of(loaded, compare=False)
            Result.begin(folder, loaded.text, notes)
            result = print_part(loaded, folder=folder, notes=notes)
            if formats:
                from inkloop.report import run_report

                run_report.write(folder, formats, {folder: result})
            return result


def load(path: Path | str, overrides: Mapping[str, Any] | None = None, **keys: Any) -> Scenario | Result:
    """Read a scenario (.toml or .ssp), or the result in a run folder.

    overrides and keys: values that replace those of a scenario. A key is dotted, {"components.controller.alpha": 0.5},
    or tables are nested as in the file, {"components": {"controller": {"alpha": 0.5}}} or grid={"nx": 20, "ny": 20}.

    Raises ScenarioError with all errors of a scenario, ResultError for a folder that holds no result.
    """
    changed = {**(overrides or {}), **keys}
    if not Path(path).is_dir():
        return _scenario(path, changed)
    if changed:
        raise TypeError(f"{path} is a run folder, whose result takes no overrides; found {', '.join(changed)}")
    return Result.load(Path(path))


def _scenario(scenario: Scenario | Path | str, overrides: Mapping[str, Any]) -> Scenario:
    if isinstance(scenario, Scenario):
        return Scenario.of_text(scenario.text, scenario.source, overrides) if overrides else scenario
    path = Path(scenario)
    with classes_from(path.parent):
        if path.suffix == ".ssp":
            from inkloop.exchange.ssp import reading

            return reading.scenario_of(path, overrides)
        return Scenario.load(path, overrides)
