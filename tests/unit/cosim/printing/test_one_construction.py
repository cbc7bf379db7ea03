"""A file that is loaded and printed: every option is checked once, every component constructed once per print."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import fmpy
import pytest

from inkloop.components import fmu_kind, fmu_parameters
from inkloop.components.fmu_kind import FmuModel
from inkloop.components.kind import Bench, Checked
from inkloop.components.python_class import PythonClass
from inkloop.errors import FmuError
from inkloop.fmu import FmuComponent, reading
from inkloop.printing.run import print_part
from inkloop.scenario import file, loop
from inkloop.scenario.file import Scenario
from inkloop.tables import part_mesh
from inkloop.tables.schema import BenchTable
from inkloop_controller import LayerMpc
from inkloop_controller.baseline_planners import OpenLoop, StochasticGreedy
from inkloop_hardware.devices.printer import Printer
from inkloop_hardware.devices.profiler import Profiler
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.mapped.mapped import Mapped
from support.benches import foreign_rig
from support.places import ROOT
from support.toys import FunctionComponent

CONTROLLERS = (LayerMpc, OpenLoop, StochasticGreedy)
SMALL = {"grid.nx": 9, "grid.ny": 9, "part.radius_um": 800, "run.layers_max": 1}
MODELS = ("LayerDeposition", "ProfileSensor")


def once(*names: str) -> dict[str, int]:
    return dict.fromkeys(names, 1)


def test_components_of_a_loop_that_cannot_be_built_are_ended() -> None:
    first, second = FunctionComponent(), FunctionComponent()

    def fail(bench: Bench, name: str) -> FunctionComponent:
        raise FmuError(f"{name} is broken")

    made: list[Any] = [lambda bench, name: first, lambda bench, name: second, fail]
    checked = {f"c{number}": Checked("it", construct=each) for number, each in enumerate(made)}
    with pytest.raises(FmuError, match="c2 is broken"):
        loop.Loop(checked, {}, [], [], [], []).build(BenchTable(), None)
    assert first.log == second.log == ["terminate"]


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> dict[str, Counter[str]]:
    """Number of calls, by name."""
    found: dict[str, Counter[str]] = {}

    def count(place: Any, name: str, what: str, key: Callable[..., str]) -> None:
        original = getattr(place, name)

        @wraps(original)
        def counted(*args: Any, **options: Any) -> Any:
            found.setdefault(what, Counter())[key(*args, **options)] += 1
            return original(*args, **options)

        monkeypatch.setattr(place, name, counted)

    reading._describe.cache_clear()
    for each in (*CONTROLLERS, Printer, Profiler, Mapped, Rig):
        count(each, "__init__", "construct", lambda self, *args, **options: type(self).__name__)
    count(FmuComponent, "__init__", "construct", lambda self, path, **options: Path(path).stem)
    count(PythonClass, "check", "check", lambda self, job, options: self.entry.name)
    count(FmuModel, "check", "check", lambda self, job, options: self.model)
    count(fmu_parameters, "parse", "parse", lambda description, *args, **options: description.name)
    for module in (fmu_parameters, fmu_kind):
        count(module, "find_fmu", "find", lambda model, form: model)
    count(fmpy, "read_model_description", "describe", lambda path, **options: Path(path).stem)
    count(file, "job_of", "job", lambda tables, target, component: component)
    count(part_mesh, "read_bodies", "read", lambda path, unit: path.name)
    count(loop, "read_events", "events", lambda *args: "read")
    return found


def test_each_component_is_checked_once_and_constructed_once_per_print(counts: dict[str, Counter[str]]) -> None:
    scenario = Scenario.load(ROOT / "scenarios" / "cylinder.toml", SMALL)
    assert counts["construct"] == once(*(each.__name__ for each in CONTROLLERS))
    runs = [scenario, *map(scenario.variant, scenario.tables.compare)]
    assert [print_part(each).dataset.sizes["layer"] for each in runs] == [2, 2, 2]
    prints = len(runs)
    assert counts["construct"] == {**once(*(each.__name__ for each in CONTROLLERS)), **dict.fromkeys(MODELS, prints)}
    assert counts["check"] == once(*(each.__name__ for each in CONTROLLERS), *MODELS)
    assert counts["parse"] == counts["find"] == counts["describe"] == once(*MODELS)
    assert counts["job"] == once("", "controller", "printer", "profiler")
    assert counts["events"] == {"read": prints}


def test_devices_are_constructed_once_with_the_bus_of_their_loop(
    tmp_path: Path, counts: dict[str, Counter[str]]
) -> None:
    (tmp_path / "rig.dbc").write_text(foreign_rig.DBC)
    (tmp_path / "rig.toml").write_text(foreign_rig.MAPPING)
    (tmp_path / "part.toml").write_text(foreign_rig.SCENARIO)
    for path, names in (
        (tmp_path / "part.toml", ("Mapped",)),
        (ROOT / "scenarios" / "bench.toml", ("Printer", "Profiler")),
    ):
        counts.pop("construct", None)
        for component in Scenario.load(path).build().values():
            component.terminate()
        assert [counts["construct"][name] for name in (*names, "Rig")] == [1] * (len(names) + 1)


def test_component_that_is_never_handed_over_is_terminated(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[str] = []
    monkeypatch.setattr("inkloop_controller.layer_controller.LayerController.terminate", lambda self: ended.append("x"))
    scenario = Scenario.load(ROOT / "scenarios" / "cylinder.toml")
    assert ended == []
    components, second = scenario.build(), scenario.build()
    assert not set(map(id, components.values())) & set(map(id, second.values()))
    for component in second.values():
        component.terminate()
    ended.clear()
    del scenario
    assert ended == ["x", "x"]  # both of the comparison runs
    for component in components.values():
        component.terminate()
    assert ended == ["x", "x", "x"]
