from __future__ import annotations

import gc
import hashlib
import sys
import types
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from inkloop.component import Component, Job, Port, Values
from inkloop.components import catalog
from inkloop.components.devices import job_with_overrides
from inkloop.components.kind import Bench
from inkloop.errors import ScenarioError
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import find_fmu
from inkloop.testing import job as small_job
from support.toys import toy_job

FANS: list[Fan] = []
"""All that were made."""


class Fan:
    """A third party's component, in as few lines as it takes."""

    inputs = ()
    outputs = (Port("speed", "m/s"),)

    def __init__(
        self,
        job: Job,
        *,
        speed: float = 1.0,
        blades: int = 3,
        mode: Literal["on", "off"] = "on",
        levels: tuple[float, ...] = (),
        parts: list[int] | None = None,
    ) -> None:
        if speed < 0:
            raise ValueError(f"speed is {speed:g}; a fan turns forwards")
        self.options = (speed, blades, mode, levels)
        self.parts = parts
        self.is_over = False
        FANS.append(self)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return {"speed": np.asarray(self.options[0])}

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        return {"speed": np.asarray(self.options[0])}

    def terminate(self) -> None:
        self.is_over = True


@pytest.fixture(autouse=True)
def workshop(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module of a third party, found by name and by entry point."""
    module = types.ModuleType("workshop")
    module.Fan = Fan  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "workshop", module)
    points = EntryPoints([EntryPoint("Fan", "workshop:Fan", catalog.GROUP)])
    monkeypatch.setattr(catalog, "entry_points", lambda **wanted: points.select(**wanted))


@pytest.mark.parametrize("kind", ["Fan", "workshop:Fan"])
def test_third_party_class_takes_part_by_name_or_entry_point(kind: str) -> None:
    fan = catalog.make(kind, toy_job(), {"speed": 2, "mode": "off", "levels": [1, 2.5]})
    assert isinstance(fan, Component)
    assert isinstance(fan, Fan)
    assert fan.options == (2.0, 3, "off", (1.0, 2.5))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sped": 1.0}, "sped is not a key of this table; did you mean speed?"),
        ({"speed": "fast"}, "speed is 'fast'; expected a number"),
        ({"blades": 2.5}, "blades is 2.5; expected a whole number"),
        ({"speed": -1.0}, "speed is -1; a fan turns forwards"),
        ({"mode": "auto"}, "mode is 'auto'; expected 'on' or 'off'"),
    ],
)
def test_wrong_option_is_named_with_what_would_be_right(options: dict[str, object], message: str) -> None:
    assert catalog.check("Fan", toy_job(), options).errors == [message]
    with pytest.raises(ScenarioError, match="1 error"):
        catalog.make("Fan", toy_job(), options)


@pytest.mark.parametrize(
    ("kind", "options", "resolved"),
    [
        ("Fmu", {"file": "a.fmu", "gain": 2.0}, {"file": "jobs/a.fmu", "gain": 2.0}),
        ("Fmu", {"file": "/a.fmu"}, {"file": "/a.fmu"}),
        ("Fmu", {"file": 3}, {"file": 3}),
        ("Fmu", {"folder": "a"}, {"folder": "a"}),
        ("PlainPlant", {"file": "a.fmu"}, {"file": "jobs/a.fmu"}),
        ("Shadow", {"file": "a.fmu"}, {"file": "jobs/a.fmu"}),
        ("MapFolder", {"folder": "scans", "file": "a"}, {"folder": "jobs/scans", "file": "a"}),
        ("hardware.mapped", {"mapping": "rig.toml"}, {"mapping": "jobs/rig.toml"}),
        ("OpenLoop", {"file": "a"}, {"file": "a"}),
        ("Fann", {"file": "a"}, {"file": "a"}),
    ],
)
def test_only_the_path_that_a_kind_names_lies_next_to_the_scenario(
    kind: str, options: dict[str, object], resolved: dict[str, object]
) -> None:
    assert catalog.resolve_paths(kind, options, Path("jobs")) == resolved


def test_each_component_of_a_class_has_options_of_its_own() -> None:
    checked = catalog.check("Fan", toy_job(), {"parts": [1, 2]})
    first, second, third = (checked.make(Bench()) for _ in range(3))
    assert len({id(first), id(second), id(third)}) == 3
    first.parts.append(3)  # type: ignore[attr-defined]
    assert second.parts == third.parts == [1, 2]  # type: ignore[attr-defined]


def test_component_lives_as_long_as_its_loop_and_one_that_is_never_made_is_ended() -> None:
    FANS.clear()
    made = catalog.check("Fan", toy_job(), {}).make(Bench())
    catalog.check("Fan", toy_job(), {})
    gc.collect()
    first, second = FANS
    assert first is made
    assert (first.is_over, second.is_over) == (False, True)
    FANS.clear()


class Lamp(Fan):
    """One that is given rig and journal of its loop."""

    def use_rig(self, rig: object) -> None:
        self.rig = rig

    def use_journal(self, journal: object) -> None:
        self.journal = journal


def test_class_is_given_the_rig_and_the_journal_of_its_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["workshop"], "Fan", Lamp)
    bench = Bench()
    lamp = catalog.make("Fan", toy_job(), {}, bench)
    assert isinstance(lamp, Lamp)
    assert (lamp.rig, lamp.journal) == (bench.rig, bench.journal)


def test_argument_behind_the_job_is_an_option_without_a_star_too(monkeypatch: pytest.MonkeyPatch) -> None:
    class Plain(Fan):
        def __init__(self, job: Job, speed: float = 1.0) -> None:
            super().__init__(job, speed=speed)

    monkeypatch.setattr(sys.modules["workshop"], "Fan", Plain)
    assert catalog.make("Fan", toy_job(), {"speed": 2.5}).options[0] == 2.5  # type: ignore[attr-defined]
    assert catalog.check("Fan", toy_job(), {"speed": "x", "job": 1}).errors == [
        "speed is 'x'; expected a number",
        "job is not a key of this table; known: speed",
    ]


@pytest.mark.parametrize(
    ("ports", "error"),
    [
        ((("y", "1", (), "flot64"),), "ports: 'y': dtype is 'flot64'; needs the name of a type of numbers"),
        ((("y",), ("z",), ("y",)), "outputs: two are called 'y'; needs a name for each"),
    ],
)
def test_ports_that_cannot_be_are_errors_of_the_component(
    ports: Any, error: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Ported(Fan):
        def __init__(self, job: Job) -> None:
            super().__init__(job)
            self.outputs = tuple(Port(*port) for port in ports)  # type: ignore[assignment]

    monkeypatch.setattr(sys.modules["workshop"], "Fan", Ported)
    (found,) = catalog.check("Fan", toy_job(), {}).errors
    assert found.startswith(error)


def test_class_that_exits_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    class Exits(Fan):
        def __init__(self, job: Job, rng: np.random.Generator | None = None) -> None:
            raise SystemExit(0)

    monkeypatch.setattr(sys.modules["workshop"], "Fan", Exits)
    (found,) = catalog.check("Fan", toy_job(), {}).errors
    assert "which cannot be constructed: SystemExit: 0" in found


def test_name_of_a_port_that_the_fmu_has_too_is_an_error_of_the_mapping() -> None:
    options = {"file": str(find_fmu("LayerDeposition")), "ports": {"status": "layers_printed"}}
    assert catalog.check("Fmu", toy_job(), options).errors == [
        "ports.status: the FMU also has a variable of that name; map it to another"
    ]


def test_required_option_that_is_wrong_is_told_once() -> None:
    found = catalog.check("MapFolder", toy_job(), {"folder": 3, "nothing": 1}).errors
    assert [error.partition(";")[0] for error in found] == ["folder is 3", "nothing is not a key of this table"]


def test_misspelt_key_does_not_replace_the_one_that_is_there_too() -> None:
    assert catalog.check("Fan", toy_job(), {"speed": -1.0, "sped": 2.0}).errors == [
        "sped is not a key of this table; did you mean speed?",
        "speed is -1; a fan turns forwards",
    ]


@pytest.mark.parametrize(
    ("kind", "options", "is_foreign"),
    [
        ("Fmu", {}, True), ("PlainPlant", {}, True), ("PlainPlant", {"plant": "workshop:Fan"}, False),
        ("Shadow", {}, False), ("Shadow", {"plant": "Fmu"}, True), ("LayerDeposition", {}, False),
        ("LayerMpc", {"plant": "Fmu"}, False),
    ],
)  # fmt: skip
def test_native_code_of_others_is_that_of_an_fmu_file(kind: str, options: dict[str, Any], is_foreign: bool) -> None:
    assert catalog.is_foreign_fmu(kind, options) is is_foreign


@pytest.mark.parametrize(("form", "fmi"), [("fmi2", 2), ("fmi3-fixed", 3), ("fmi3", 3)])
def test_model_of_any_form_has_the_grid_of_the_job(form: str, fmi: int) -> None:
    model = catalog.make("LayerDeposition", small_job(6, 5), {"fmi": form})
    assert isinstance(model, FmuComponent)
    assert model.description.fmi == fmi
    assert {port.name: port.shape for port in model.outputs}["height"] == (6, 5)
    model.terminate()


def test_file_of_an_fmu_has_the_grid_of_the_job_and_outputs_that_are_mapped_alone() -> None:
    options = {"file": str(find_fmu("LayerDeposition", "fmi3")), "ports": {"surface": "height"}}
    checked = catalog.check("Fmu", small_job(6, 5), options)
    assert checked.ports is not None
    part = checked.make(Bench())
    for ports in (checked.ports.outputs, part.outputs):
        shapes = {port.name: port.shape for port in ports}
        assert shapes["surface"] == (6, 5)
        assert "height" not in shapes
    assert {port.name: port.shape for port in part.inputs}["pattern"] == (6, 5)
    content = find_fmu("LayerDeposition", "fmi3").read_bytes()
    assert part.sha256 == hashlib.sha256(content).hexdigest()  # type: ignore[attr-defined]
    part.terminate()


def test_only_a_file_that_is_not_there_is_sought_in_the_folder_of_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "bad.fmu").write_text("no archive")
    for name, sought in (("none.fmu", True), ("bad.fmu", False)):
        (error,) = catalog.check("Fmu", toy_job(), {"file": str(tmp_path / name)}).errors
        assert error.endswith("; give its path from the scenario's folder") == sought


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, (1, 1, 0)),
        ({"passes": 4, "pass_order": "diagonal", "pass_rotation": 3}, (4, 2, 3)),
        ({"passes": 4, "pass_order": 1}, (4, 1, 0)),
    ],
)
def test_passes_of_the_options_win_over_those_of_the_job(
    options: dict[str, Any], expected: tuple[int, int, int]
) -> None:
    job = small_job(6, 5)
    found = job_with_overrides(job, options)
    assert (found.passes, found.pass_order, found.pass_rotation) == expected
    assert (found.nx, found.ny, found.pitch, found.inks) == (job.nx, job.ny, job.pitch, job.inks)
