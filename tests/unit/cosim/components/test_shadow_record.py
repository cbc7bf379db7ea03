"""Records of a run on devices: the surface that is judged, and the shadow's report layer by layer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from inkloop.component import Component
from inkloop.components.shadow import Shadow
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.master.master import Master
from inkloop.report import PNG, run_report
from inkloop.report.remarks import remarks
from inkloop.results.recorder import LayerRow, Recorder
from inkloop.results.result import Result
from support.benches.device_toys import DevicePrinter, DeviceProfiler, StartingPrinter
from support.toys import DROPLET, ToyController, ToyProfiler, toy_job

SECOND = 1_000_000_000
JOB = toy_job()
LAYERS = 4


def parts(profiler: str, shadow: bool = True) -> dict[str, Component]:
    """A loop on a device printer that jets nothing in layer 2."""
    printer = DevicePrinter(JOB)
    printer.disturb = lambda layer, pattern: 0 * pattern if layer == 2 else pattern
    found: dict[str, Component] = {"controller": ToyController(JOB), "printer": printer}
    found["profiler"] = DeviceProfiler(JOB, printer) if profiler == "device" else ToyProfiler(JOB)
    if shadow:
        found["shadow"] = Shadow(JOB, StartingPrinter, start="scan" if profiler == "device" else "job")
    return found


def printed(components: dict[str, Component]) -> tuple[Recorder, list[LayerRow], Master]:
    rows: list[LayerRow] = []
    recorder = Recorder(JOB, components, rows.append)
    master = Master(
        components,
        contract_connections(components),
        step_ns=SECOND,
        observers=[recorder],
        course=LayerCourse(components, layers_max=LAYERS),
    )
    master.run()
    return recorder, rows, master


def test_record_is_judged_by_scans_or_else_by_the_shadow() -> None:
    recorder, rows, _ = printed(parts("simulated"))
    run = recorder.dataset()
    np.testing.assert_array_equal(run.height, run.shadow_height)
    assert [row.mean_error for row in rows] == pytest.approx(run.mean_error.values, rel=1e-9, abs=0.0)
    run = printed(parts("device", shadow=False))[0].dataset()
    np.testing.assert_allclose(run.mean_error / DROPLET, [5, 4, 4, 3, 2])
    assert "shadow_height" not in run


@pytest.mark.system
@pytest.mark.filterwarnings("ignore:Data has no positive values")  # toy layers are all even
def test_print_on_devices_is_judged_by_its_scans_and_compared_with_its_shadow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder, rows, master = printed(parts("device"))
    run = recorder.dataset()
    np.testing.assert_array_equal(run.height, run.measured_height)
    np.testing.assert_allclose(run.mean_error / DROPLET, [5, 4, 4, 3, 2])
    assert [row.layer for row in rows] == [0, 1, 2, 3, 4]
    assert [row.mean_error for row in rows] == pytest.approx(run.mean_error.values, rel=1e-9, abs=0.0)
    np.testing.assert_allclose(run.shadow_height[:, 1, 1] / DROPLET, [0, 1, 2, 3, 4])
    np.testing.assert_allclose(run.growth_divergence[1:] / DROPLET, [0, 1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(run.surface_divergence / DROPLET, [0, 0, 1, 1, 1], atol=1e-12)
    assert np.isnan(run.growth_divergence[0])
    assert run.shadow_status.values.tolist() == [0, 0, 4, 0, 0]
    for other in ("surfaces", "cross_section", "error_map", "layers"):
        monkeypatch.setattr(f"inkloop.report.pictures.{other}", lambda *_: Figure())
    keys = {"title": "Toy", "label": "toy", "scenario_text": 'title = "Toy"\n', "seed": 0, "stop_reason": "layers_max"}
    result = Result.of(run, **keys, wall_s=master.wall_s, components={})  # type: ignore[arg-type]
    result.save(tmp_path)
    run_report.write(tmp_path, [PNG])
    message = "layer 2 grew differently from the shadow's model, by 10.00 µm rms"
    assert remarks(result) == [message]
    assert f"toy: {message}" in (tmp_path / "summary.txt").read_text("utf-8")
    assert (tmp_path / "divergence.png").stat().st_size > 1000
