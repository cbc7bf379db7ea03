"""Devices and simulated parts go together only where a component connects the two."""

from __future__ import annotations

from pathlib import Path

import pytest

from inkloop.component import Component, Job
from inkloop.course.layer_course import contract_connections
from inkloop.errors import ScenarioError
from inkloop.printing.print import Print
from inkloop.scenario.file import Scenario
from inkloop.scenario.validation import mix_errors
from support.benches.device_toys import DevicePrinter, DeviceProfiler
from support.toys import ToyPrinter, ToyProfiler, toy_job

HERE = __name__
PRINTERS = {"FMU": 'kind = "LayerDeposition"', "device": f'kind = "{HERE}:device_printer"'}
PROFILERS = {"FMU": 'kind = "ProfileSensor"\npreset = "exact"', "device": f'kind = "{HERE}:device_profiler"'}
SHADOWS = {"no shadow": "", "shadow": '[components.shadow]\nkind = "Shadow"\nstart = "{start}"'}


def device_printer(job: Job) -> DevicePrinter:
    return DevicePrinter(job)


def device_profiler(job: Job) -> DeviceProfiler:
    return DeviceProfiler(job)


def scenario(folder: Path, printer: str, profiler: str, shadow: str, start: str = "scan") -> Scenario:
    path = folder / "mix.toml"
    path.write_text(
        f"""
title = "Mix"
grid = {{ nx = 9, ny = 9 }}
part = {{ shape = "cuboid", size_x_um = 1300.0, size_y_um = 1300.0, height_um = 20.0 }}
run = {{ layers_max = 2 }}
[components.controller]
kind = "OpenLoop"
[components.printer]
{PRINTERS[printer]}
[components.profiler]
{PROFILERS[profiler]}
{SHADOWS[shadow].format(start=start)}
"""
    )
    return Scenario.load(path)


@pytest.mark.parametrize(
    ("printer", "profiler", "shadow", "start"),
    [
        ("FMU", "FMU", "no shadow", ""),
        ("FMU", "FMU", "shadow", "scan"),
        ("device", "device", "no shadow", ""),
        ("device", "device", "shadow", "scan"),
        ("device", "FMU", "shadow", "job"),
        ("FMU", "device", "shadow", "scan"),
    ],
)
def test_legal_mix_prints(printer: str, profiler: str, shadow: str, start: str, tmp_path: Path) -> None:
    result = Print(scenario(tmp_path, printer, profiler, shadow, start)).run()
    assert result.metrics()["layers"] == 2
    assert ("shadow_height" in result.dataset) == (shadow == "shadow")


@pytest.mark.parametrize(
    ("printer", "profiler", "message"),
    [
        (
            "device",
            "FMU",
            "printer is a device and profiler simulates a sensor, which has no surface to scan; add a com",
        ),
        (
            "FMU",
            "device",
            "profiler is a device and printer simulates a printer, of which profiler sees nothing; add a c",
        ),
    ],
)
def test_other_mix_is_refused_and_the_message_names_what_is_missing(
    printer: str, profiler: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario(tmp_path, printer, profiler, "no shadow")
    (error,) = refused.value.errors
    assert error.startswith(message)
    assert 'with kind = "Shadow", a model that follows the commanded patterns' in error


def test_shadow_does_not_begin_on_a_scan_of_itself(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario(tmp_path, "device", "FMU", "shadow", "scan")
    (error,) = refused.value.errors
    assert error.startswith("shadow begins on the first scan of profiler, which scans shadow itself; write start =")


def test_sensor_scans_the_printer_where_printer_and_shadow_both_have_a_height(tmp_path: Path) -> None:
    for printer, source in (("FMU", "printer.height"), ("device", "shadow.height")):
        wires = scenario(tmp_path, printer, "FMU", "shadow", "job").connections
        assert [wire.source for wire in wires if wire.target == "profiler.height"] == [source]


def test_two_shadows_are_asked_about() -> None:
    class Model(ToyPrinter):
        is_shadow = True

    job = toy_job()
    parts: dict[str, Component] = {"one": Model(job), "other": Model(job), "profiler": ToyProfiler(job)}
    assert not [wire for wire in contract_connections(parts) if wire.target == "profiler.height"]


def test_each_side_alone_is_legal() -> None:
    job = toy_job()
    assert mix_errors({"printer": DevicePrinter(job)}) == []
    assert mix_errors({"profiler": DeviceProfiler(job)}) == []
    assert mix_errors({}) == []
