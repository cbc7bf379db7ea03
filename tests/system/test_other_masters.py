"""The loop of three FMUs prints the same part, bit by bit, in any master that hands on scan 0, by any algorithm."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from inkloop.cli import main
from inkloop.fmu_writer.export import export_fmu, find_fmu
from support.benches.bench_run import write
from support.fmus.fmu_checkers import by_fmutool, by_vdm_check
from support.fmus.fmu_driver import FORMS, MODELS
from support.long_proofs import rest_is_long
from support.masters.cofmupy_master import COFMUPY, RealsOnly
from support.masters.container_master import by_container, exchanged_by_container
from support.masters.java_programs import MAESTRO, VDM_CHECK
from support.masters.loops import LAYERS, ONE_BLOCK, STEPS_S, TEXT, THREE_FMUS, Loop, difference, our_run, scenario_in
from support.masters.other_masters import FMUCONTAINER, JACOBI, MASTERS, Master, layers_by

NO_SCAN_0 = "its connections start at zero: the controller does not learn datum and noise from scan 0"
REALS_ONLY = "cofmupy 1.0 sets all variables of FMI 2, and reads all outputs of either version, as one real number"


def cases() -> Iterator[Any]:
    # the steps of a block are those of contract/test_layer_job_fmu.py: it learns from a layer at the end of its period
    for loop, steps_s in ((THREE_FMUS, (min(STEPS_S), max(STEPS_S))), (ONE_BLOCK, (min(STEPS_S),))):
        for master in MASTERS:
            for number, (fmi, algorithm) in enumerate(master.forms_of(loop)):
                for step_s in steps_s:
                    name = f"{loop.name} by {master.name} FMI {fmi} {algorithm} {step_s} s"
                    # Maestro takes up to a minute
                    is_first = number == 0 and step_s == min(STEPS_S)
                    is_long = master.program is MAESTRO or not is_first
                    marks = [pytest.mark.long] if is_long else []
                    if loop is THREE_FMUS and "simulate_ssp" in master.name:
                        marks.append(pytest.mark.xfail(strict=True, reason=NO_SCAN_0))
                    if master.program is COFMUPY:
                        marks.append(pytest.mark.xfail(strict=True, raises=RealsOnly, reason=REALS_ONLY))
                    yield pytest.param(loop, master, fmi, algorithm, step_s, id=name, marks=marks)


@pytest.fixture(autouse=True)
def without_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """No block draws its target, which takes longer than its print."""
    monkeypatch.setattr("inkloop.exchange.job_picture.target_picture", lambda *_: b"")


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return our_run(tmp_path_factory.mktemp("ours"))


@pytest.mark.parametrize(("loop", "master", "fmi", "algorithm", "step_s"), list(cases()))
def test_every_master_prints_the_layers_of_ours(
    loop: Loop, master: Master, fmi: str, algorithm: str, step_s: float, ours: Any, tmp_path: Path
) -> None:
    if absent := master.program.reason_it_is_absent():
        pytest.skip(absent)
    assert difference(layers_by(master, loop, fmi, algorithm, step_s, tmp_path), loop.layers_of(ours)) == ""


@pytest.mark.long
@pytest.mark.xfail(strict=True, reason="fmucontainer 2.0 skips the parameter sets of an .ssp")
def test_fmucontainer_prints_an_ssp_as_it_is(ours: Any, tmp_path: Path) -> None:
    alone = replace(FMUCONTAINER, run=partial(by_container, reads_parameters=False))
    found = layers_by(alone, THREE_FMUS, "2", JACOBI, 1.0, tmp_path)
    assert difference(found, THREE_FMUS.layers_of(ours)) == ""


ONE_WAY = "fmucontainer 2.0 carries frames to earlier FMUs of its list only, those of the standard's demo nodes too"


@pytest.fixture(scope="module")
def packed_benches(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, int]]:
    folder = tmp_path_factory.mktemp("benches")
    assert main(["export", "bench", str(write(folder)), "--out", str(folder / "bench.fmu"), "--quiet"]) == 0
    return exchanged_by_container(folder / "bench.fmu", folder, 300)


@pytest.mark.parametrize(
    ("sender", "taker"),
    [("other", "one"), pytest.param("one", "other", marks=pytest.mark.xfail(strict=True, reason=ONE_WAY))],
)
def test_benches_hear_each_other_in_fmucontainer(sender, taker, packed_benches) -> None:
    assert packed_benches[sender][0] == packed_benches[taker][1] > 10


@pytest.mark.parametrize("loop", [THREE_FMUS, ONE_BLOCK], ids=["three FMUs", "one block"])
def test_layers_that_are_compared_are_not_all_alike(loop: Loop, ours: Any) -> None:
    layers = loop.layers_of(ours)
    assert layers.shape == (LAYERS, 36 if loop is THREE_FMUS else 2)
    assert len({layer.tobytes() for layer in layers}) == LAYERS
    assert np.unique(layers).size > LAYERS


def test_difference_of_prints_is_reported() -> None:
    print_ = np.zeros((3, 2, 2))
    other = print_.copy()
    other[1, 0, 1] = 2e-6
    assert difference(print_, print_) == ""
    assert difference(other, print_) == "layer 2 differs by up to 2e-06"
    assert difference(print_[:2], print_) == "2 layers instead of 3"


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("model", rest_is_long(MODELS, 2))
def test_fmutool_finds_nothing_wrong(model: str, form: str, tmp_path: Path) -> None:
    assert by_fmutool(find_fmu(model, form)) == []
    if form == "fmi2":
        assert by_fmutool(export_fmu(model, fmi="2", nx=3, ny=2, fixed=True, out=tmp_path / "it.fmu")) == []


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """An FMU with a parameter that claims to change continuously, which is valid XML and forbidden by FMI."""
    path = tmp_path / "broken.fmu"
    with zipfile.ZipFile(find_fmu("ProfileSensor", "fmi2")) as read, zipfile.ZipFile(path, "w") as archive:
        text = read.read("modelDescription.xml").decode()
        changed = re.sub('variability="fixed"', 'variability="continuous"', text, count=1)
        assert changed != text
        archive.writestr("modelDescription.xml", changed)
    return path


def test_fmutool_finds_what_is_wrong(broken: Path) -> None:
    assert by_fmutool(broken)


@pytest.mark.long
@pytest.mark.parametrize("model", [*MODELS, ONE_BLOCK.name])
def test_vdm_check_finds_nothing_wrong(model: str, tmp_path: Path) -> None:
    if absent := VDM_CHECK.reason_it_is_absent():
        pytest.skip(absent)
    block = ONE_BLOCK.system_of(scenario_in(tmp_path), "2", tmp_path).part(ONE_BLOCK.part).file
    assert by_vdm_check(block if model == ONE_BLOCK.name else find_fmu(model, "fmi2")) == []


@pytest.mark.long
def test_vdm_check_finds_what_is_wrong(broken: Path) -> None:
    if absent := VDM_CHECK.reason_it_is_absent():
        pytest.skip(absent)
    assert any("invalid at modelDescription" in error for error in by_vdm_check(broken))


def test_fmus_for_maestro_have_integers_in_place_of_enumerations(tmp_path: Path) -> None:
    scenario_in(tmp_path)
    four = ["--set", "process.passes=4", "--set", "process.pass_order=diagonal"]
    folder = tmp_path / "it"
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--to", "maestro", "-o", str(folder), *four]) == 0
    variables = [v for file in folder.glob("*.fmu") for v in fmpy.read_model_description(str(file)).modelVariables]
    assert {v.type for v in variables} == {"Real", "Integer", "Boolean"}
    orders = {v.start for v in variables if v.name == "pass_order"}
    assert orders == {"2"}
    assert by_fmutool(folder / "printer.fmu") == []
    recorded = json.loads((folder / "simulation.json").read_text(encoding="utf-8"))["logVariables"]
    assert "status" in recorded["{controller}.controller"]  # nothing is connected to it
    assert {"height_mean", "layers_printed"} <= set(recorded["{printer}.printer"])
    assert "height[1,1]" in recorded["{printer}.printer"]
    assert "estimated_height[1,1]" not in recorded["{controller}.controller"]
    rows = fmpy.simulate_fmu(str(folder / "printer.fmu"), stop_time=1.0, output=["status"])
    assert rows["status"][-1] == 0


def test_names_that_maestro_cannot_read_are_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "block.toml").write_text(TEXT.replace(".printer]", ".print-head]"), encoding="utf-8")
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--to", "maestro", "-o", str(tmp_path / "it")]) == 1
    assert "components.print-head: Maestro takes letters, digits and _ in names" in capsys.readouterr().err
    assert not (tmp_path / "it").exists()
