"""`inkloop bench replay`: a run on devices once more, from its traffic log and without a bus.

Controller, devices, links and services are those of a print; only the nodes' answers come from the log. Frames of the
master are compared with the log byte for byte, patterns and maps with the result of the run.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from inkloop.components import devices
from inkloop.contract import MEASURED_HEIGHT, PATTERN, VALID
from inkloop.errors import ComponentError, InkloopError, ResultError
from inkloop.files import temporary_folder
from inkloop.printing.on_devices import live_words
from inkloop.printing.run import new_run_folder, print_part, scenario_of_run
from inkloop.report.terminal import Terminal
from inkloop.results.result import RESULT_FILE, UNFINISHED, Result
from inkloop.scenario.file import Scenario

COMPARED = {PATTERN: "patterns", MEASURED_HEIGHT: "scans", VALID: "valid cells", "estimated_height": "estimates"}
SAME, DIFFERS = 0, 1
"""Exit codes."""


def replay(options: argparse.Namespace, overrides: Mapping[str, Any], console: Terminal) -> int:
    """Print again from the log and report differences; returns the exit code. Raises ResultError, ScenarioError."""
    folder: Path = options.run
    with ExitStack() as stack:
        scenario = stack.enter_context(_scenario(folder, overrides, options.log))
        if options.out:
            place = new_run_folder(options.out, folder.name)
        else:
            place = stack.enter_context(temporary_folder("replay"))
        recorded = Result.load(folder) if (folder / RESULT_FILE).is_file() else None
        found = _replayed(scenario, place, is_whole=recorded is None or recorded.stop_reason not in UNFINISHED)
        again = Result.load(place) if (place / RESULT_FILE).is_file() else None
    if recorded and again and not found:
        found = differences(recorded, again)
    for words in found:
        console.sentence(words)
    console.failures(found)
    console.result(same=not found, differences=found)
    if found:
        return DIFFERS
    done, log = _layers(again.dataset) if again else "0 layers", scenario.tables.bench.channel
    summary = f"{done} replayed: every request of the master is that of {log}"
    if recorded:
        summary += f"; {', '.join(COMPARED.values())} are those of {folder / RESULT_FILE}"
    console.sentence(summary)
    return SAME


def differences(recorded: Result, again: Result) -> list[str]:
    """A sentence for each array in which two runs differ: the first layer, how many cells, the first of them."""
    found = []
    left, right = recorded.dataset, again.dataset
    if left.sizes["layer"] > right.sizes["layer"]:
        found.append(f"the replay has {_layers(right)}, the run {_layers(left)}")
    layers = min(left.sizes["layer"], right.sizes["layer"])
    for name, words in COMPARED.items():
        if name not in left or name not in right:
            continue
        for layer in range(layers):
            one, other = left[name].values[layer], right[name].values[layer]
            differing = np.argwhere(~((one == other) | ((one != one) & (other != other))))  # NaN is as NaN
            if len(differing):
                i, j = differing[0]
                found.append(
                    f"{words} differ from layer {layer} on: {len(differing)} cells, the first is ({i}, {j}), "
                    f"{one[i, j]:g} in the run and {other[i, j]:g} in the replay"
                )
                break
    return found


def _layers(run: xr.Dataset) -> str:
    count = run.sizes["layer"] - 1
    return f"{count} layer{'' if count == 1 else 's'}"


@contextmanager
def _scenario(folder: Path, overrides: Mapping[str, Any], other_log: Path | None) -> Iterator[Scenario]:
    """The scenario of a run, on the bus of its log. Raises ResultError where there is nothing to replay."""
    with scenario_of_run(folder, overrides) as scenario:
        kinds = {table.kind for table in scenario.tables.components.values()}
        log = other_log or folder / scenario.tables.bench.traffic_log
    if kinds.isdisjoint(devices.KINDS):
        raise ResultError(f"{folder}: no component of this run is a device; what was not on a bus cannot be replayed")
    if not log.is_file():
        raise ResultError(f"{folder}: there is no traffic log {log}; name one with --log (bench.traffic_log writes it)")
    on_the_log = {"bench.interface": "replay", "bench.channel": str(log), "bench.traffic_log": ""}
    with scenario_of_run(folder, {**overrides, **on_the_log}) as scenario:
        yield scenario


def _replayed(scenario: Scenario, place: Path, is_whole: bool) -> list[str]:
    """Print into a folder; the differences if it ends otherwise than the recorded run, which came to its end or not
    (is_whole).
    """
    place.mkdir(parents=True, exist_ok=True)
    errors = importlib.import_module("inkloop_hardware.errors")
    try:
        with live_words(Terminal(quiet=True), place):
            print_part(scenario, folder=place)
    except ComponentError as error:
        cause = _first_cause(error)
        of_the_bench = isinstance(cause, errors.HardwareError) and not isinstance(cause, errors.BusError)
        if not is_whole and (of_the_bench or isinstance(cause, errors.ReplayEnded)):
            return []  # the recorded run ended there too
        return [str(cause)]
    return []


def _first_cause(error: InkloopError) -> InkloopError:
    """The innermost InkloopError that caused an error."""
    while isinstance(error.__cause__, InkloopError):
        error = error.__cause__
    return error
