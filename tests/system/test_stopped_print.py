"""A print that its controller stops: exit code, last lines, records, and `inkloop resume` after a person has looked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.printing.print import Print
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_hardware.devices.profiler import Profiler
from support.benches.bench_run import BLOCK, emulated, write

pytestmark = pytest.mark.usefixtures("without_pictures")

PROFILER = """
import io
from pathlib import Path

import numpy as np

from inkloop.contract import HEIGHT, LAYERS_PRINTED, LAYERS_SCANNED, MEASURED_HEIGHT, VALID, contract_ports


class Freezing:
    'Its scans from layer 10 on are that of layer 9, until a file says that it is repaired.'

    def __init__(self, job, *, repaired: str, freezes: bool = True):
        shape = (job.nx, job.ny)
        self.inputs = contract_ports(shape, HEIGHT, LAYERS_PRINTED)
        self.outputs = contract_ports(shape, MEASURED_HEIGHT, VALID, LAYERS_SCANNED)
        self._freezes, self._repaired = freezes, Path(repaired)
        self._scanned, self._shown = -1, np.zeros(shape)

    def initialize(self, time_ns, inputs):
        return self._outputs()

    def do_step(self, time_ns, step_ns, inputs):
        layer = int(inputs[LAYERS_PRINTED])
        if layer > self._scanned:
            self._scanned = layer
            if layer < 10 or not self._freezes or self._repaired.exists():
                noise = np.random.default_rng(layer).standard_normal(self._shown.shape)
                self._shown = inputs[HEIGHT] + 0.1e-6 * noise
        return self._outputs()

    def terminate(self):
        pass

    def save(self):
        buffer = io.BytesIO()
        np.savez(buffer, scanned=self._scanned, shown=self._shown)
        return buffer.getvalue()

    def restore(self, saved):
        with np.load(io.BytesIO(saved)) as arrays:
            self._scanned, self._shown = int(arrays["scanned"]), arrays["shown"]

    def _outputs(self):
        return {
            MEASURED_HEIGHT: self._shown.copy(),
            VALID: np.ones(self._shown.shape, np.bool_),
            LAYERS_SCANNED: np.asarray(self._scanned, np.int32),
        }
"""
SCENARIO = """
title = "Block under a profiler that freezes"
seed = 5

[grid]
nx = 20
ny = 18

[part]
shape = "cuboid"
size_x_um = 3600.0
size_y_um = 3100.0
height_um = 90.0

[run]
layers_max = 60

[components.controller]
kind = "KIND"
horizon = 2

[components.printer]
kind = "LayerDeposition"
variation = 0.2
variation_kind = "per_droplet"

[components.profiler]
kind = "freezing:Freezing"
repaired = "REPAIRED"
"""
KINDS = ["LayerMpc", "LayerController"]


@pytest.fixture(params=KINDS)
def scenario(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    (tmp_path / "freezing.py").write_text(PROFILER)
    path = tmp_path / "block.toml"
    path.write_text(SCENARIO.replace("KIND", request.param).replace("REPAIRED", str(tmp_path / "repaired")))
    return path


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_stopped_print_says_why_and_goes_on_after_a_repair(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["run", str(scenario), "--out", str(folder)]) == 4
    shown = said(capsys)
    sentence = "the profiler shows the scan of an earlier layer again, the same to the last bit, as that of layer 11"
    assert f"stopped: the scans do not show what was printed: {sentence}" in shown
    assert shown.endswith(f"when you have looked at it, continue with `inkloop resume {folder}`")
    assert sentence in " ".join((folder / "summary.txt").read_text(encoding="utf-8").split())
    assert main(["info", str(folder)]) == 0
    shown = said(capsys)
    assert "ended: stopped, after 11 layers" in shown
    assert sentence in shown
    run = Result.load(folder).dataset
    assert run.stop_reason.values.tolist() == [0] * 11 + [128]
    assert int(run.stop_layer[-1]) == 11
    assert float(run.stop_figure[-1]) > 5.0
    assert run.stop_reason.attrs["flag_meanings"].split()[7] == "same_scan"
    assert not run.pattern.sizes["layer"] > 12

    (tmp_path / "repaired").touch()
    assert main(["resume", str(folder), "--json"]) == 0
    (figures,) = json.loads(capsys.readouterr().out)["runs"].values()
    assert figures["stop_reason"] == "done"
    assert any(remark.startswith(f"was stopped and resumed: {sentence}") for remark in figures["remarks"])
    result = Result.load(folder)
    assert -result.metrics()["min"] < 3e-6
    assert not (folder / "layers").exists()
    assert int(result.dataset.stop_reason[11]) == 128
    assert not result.dataset.stop_reason[12:].any()


def test_print_whose_comparison_alone_is_stopped_is_done(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = scenario.read_text().replace('Freezing"', 'Freezing"\nfreezes = false')
    table = text[text.index("[components.profiler]") :].replace("freezes = false", "freezes = true")
    scenario.write_text(f"{text}\n{table.replace('[components', '[compare.frozen.components')}")
    assert main(["run", str(scenario), "--out", str(tmp_path / "run")]) == 0
    assert "frozen: stopped: the scans do not show what was printed: the profiler shows" in said(capsys)
    freezing = ["--set", "components.profiler.freezes=true"]
    assert main(["run", str(scenario), "--out", str(tmp_path / "other"), *freezing]) == 4
    assert len(list((tmp_path / "other").glob("compare/*/result.nc"))) == 1


def test_stopped_print_on_a_bench_leaves_it_safe_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The profiler's answers from layer 3 on are those of layer 2; then it is repaired."""
    path, folder, frozen = (
        write(tmp_path, BLOCK.replace("height_um = 15.0", "height_um = 45.0")),
        tmp_path / "run",
        dict[str, Any](),
    )
    outputs = Profiler._outputs

    def freeze(profiler: Profiler) -> Any:
        values = outputs(profiler)
        if values["layers_scanned"] < 3:
            frozen.update(measured_height=values["measured_height"].copy(), valid=values["valid"].copy())
            return values
        return {**values, **{name: value.copy() for name, value in frozen.items()}}

    with emulated(path) as (_, channel):
        scenario = Scenario.load(path, {"bench.channel": channel})
        with monkeypatch.context() as patch:
            patch.setattr(Profiler, "_outputs", freeze)
            stopped = Print(scenario, folder).run()
        assert (stopped.stop_reason, int(stopped.dataset.stop_reason[-1])) == ("stopped", 128)
        assert main(["bench", "status", str(path), "--json", "--set", f"bench.channel={channel}"]) == 0
        nodes = json.loads(capsys.readouterr().out)["nodes"]
        assert [node["state"] for node in nodes] == ["SAFE"] * 4
        layers = stopped.dataset.sizes["layer"] - 1
        assert (nodes[0]["layer"], nodes[0]["done"]) == (layers, 4)
        assert layers <= 5
        done = Print(scenario, folder).run()
    assert done.stop_reason == "done"
    np.testing.assert_array_equal(done.dataset.pattern[: layers + 1], stopped.dataset.pattern)
    assert -done.metrics()["min"] < 4e-6
