"""Every kind of component passes the contract checks of `inkloop.testing`, and broken components fail them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Port, Values
from inkloop.components import catalog, fmu_kind
from inkloop.contract import contract_ports
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import export_fmu
from inkloop.testing import (
    RESUMABLE_CONTRACT_CHECKS,
    ContractCheck,
    inputs_are_left_alone,
    it_is_a_component,
    job,
    names_of_ports_are_unique,
    outputs_are_as_declared_from_the_start_on,
    outputs_of_a_step_stay_as_they_were,
    restored_component_continues_with_the_same_bits,
    same_inputs_give_the_same_bits,
)
from support.fmus.amplifier import build
from support.toys import FunctionComponent

JOB = job()
FORMS = ("fmi3", "fmi3-fixed", "fmi2")
CONTROLLERS = [kind for kind in catalog.PYTHON_KINDS if kind != catalog.MAP_FOLDER]


def recorded_maps(folder: Path) -> Component:
    """A folder with the maps of layers 0 to 9, each 4 x 4 pixels a cell."""
    for layer in range(10):
        heights = layer + np.linspace(0.0, 1.0, JOB.nx * 4 * JOB.ny * 4).reshape(JOB.nx * 4, JOB.ny * 4)
        np.savez(folder / f"{layer}.npz", z_um=heights, pixel_um=JOB.pitch * 1e6 / 4)
    corner_um = -0.375 * JOB.pitch * 1e6
    options = {"folder": str(folder), "file_name": "{layer}.npz", "replay": True, "complete": "renamed"}
    return catalog.make("MapFolder", JOB, {**options, "offset_x_um": corner_um, "offset_y_um": corner_um})


FMUS: dict[str, dict[str, Any]] = {
    **{model: {} for model in (*catalog.DEPOSITION_MODELS, "LayerController")},
    "ProfileSensor": {"noise_std_um": 0.5},
}


def maker(kind: str, **options: Any) -> Callable[[Path], Component]:
    """Makes a component of a kind, in any folder."""
    return lambda _: catalog.make(kind, JOB, options)


MAKERS: dict[str, Callable[[Path], Component]] = {
    **{f"{kind} {form}": maker(kind, fmi=form, **options) for kind, options in FMUS.items() for form in FORMS},
    **{kind: maker(kind) for kind in CONTROLLERS},
    "MapFolder": recorded_maps,
}
OURS = [
    pytest.param(make, id=name, marks=[pytest.mark.long] if name.endswith("fixed") else [])
    for name, make in MAKERS.items()
]
FOREIGN = [
    pytest.param(
        lambda folder, fmi=fmi: FmuComponent(build(folder, fmi)), id=f"foreign FMI {fmi}", marks=pytest.mark.compiled
    )
    for fmi in (2, 3)
]


@pytest.fixture(scope="module", autouse=True)
def exported_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The FMUs for the grid of the job are written once, not for every component."""
    folder = tmp_path_factory.mktemp("exported")

    @cache
    def once(model: str, **options: Any) -> Path:
        return export_fmu(model, out=folder / f"{model}-{options['fmi']}.fmu", **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fmu_kind, "export_fmu", lambda model, out, **options: once(model, **options))
        yield


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
@pytest.mark.parametrize("make", [*OURS, *FOREIGN])
def test_ours_keep(make: Callable[[Path], Component], check: ContractCheck, tmp_path: Path) -> None:
    check(lambda: make(tmp_path))


Y = Port("y", shape=(2,))


def counting(start: int = 0) -> Component:
    """A component that writes into one array, step by step."""
    kept = np.full(2, float(start))

    def step(time_ns: int, step_ns: int, values: Values) -> Values:
        np.add(kept, 1, out=kept)
        return {"y": kept}

    return FunctionComponent(outputs=[Y], step=step)


def writing() -> Component:
    def step(time_ns: int, step_ns: int, values: Values) -> Values:
        values["x"][...] = 0
        return {}

    return FunctionComponent(inputs=[Port("x")], step=step)


class Lacking:
    """Only ports."""

    inputs = outputs = ()


class Forgetful(FunctionComponent):
    """Adds up its steps, and saves nothing of that."""

    def __init__(self) -> None:
        super().__init__(outputs=[Y], step=self._count)
        self._kept = np.zeros(2)

    def _count(self, time_ns: int, step_ns: int, values: Values) -> Values:
        self._kept = self._kept + 1
        return {"y": self._kept}

    def save(self) -> bytes:
        return b""

    def restore(self, state: bytes) -> None:
        self._kept = np.zeros(2)


numbers = iter(range(1_000))


@pytest.mark.parametrize(
    ("check", "broken", "message"),
    [
        (it_is_a_component, Lacking, "Lacking has no initialize, do_step, terminate"),
        (names_of_ports_are_unique, lambda: FunctionComponent(outputs=[Y, Y]), "twice among y, y"),
        (
            outputs_are_as_declared_from_the_start_on,
            lambda: FunctionComponent(outputs=[Y], start=lambda values: {}),
            r"initialize returns \[\]; declared are \['y'\]",
        ),
        (
            outputs_are_as_declared_from_the_start_on,
            lambda: FunctionComponent(outputs=[Y], start=lambda values: {"y": np.zeros(3)}),
            r"initialize returns y as \(\(3,\), 'float64'\)",
        ),
        (same_inputs_give_the_same_bits, lambda: counting(next(numbers)), "y differs from that of a second component"),
        (outputs_of_a_step_stay_as_they_were, counting, "y differs from that of the same arrays two steps later"),
        (restored_component_continues_with_the_same_bits, counting, "FunctionComponent has no save"),
        (restored_component_continues_with_the_same_bits, Forgetful, "y differs from that of the restored one in ste"),
        (names_of_ports_are_unique, lambda: FunctionComponent(inputs=[Y, Y]), "twice among y, y"),
        (
            outputs_are_as_declared_from_the_start_on,
            lambda: FunctionComponent(outputs=[Y], step=lambda *_: {"y": np.zeros(2), "z": np.zeros(2)}),
            r"do_step 0 returns \['y', 'z'\]; declared are \['y'\]",
        ),
        (
            outputs_are_as_declared_from_the_start_on,
            lambda: FunctionComponent(outputs=[Y], step=lambda *_: {"y": np.zeros(2, np.float32)}),
            r"do_step 0 returns y as \(\(2,\), 'float32'\); declared is \(\(2,\), 'float64'\)",
        ),
    ],
)
def test_broken_contract_is_reported(check: ContractCheck, broken: Callable[[], Component], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check(broken)


def test_writing_into_an_input_is_caught() -> None:
    with pytest.raises(ValueError, match="read-only"):
        inputs_are_left_alone(writing)


def test_checks_print_and_scan_a_layer_a_second_on_a_surface_that_slopes_and_grows() -> None:
    given: list[Values] = []

    def step(time_ns: int, step_ns: int, values: Values) -> Values:
        given.append({**values, "time": np.asarray((time_ns, step_ns))})
        return {}

    names = ("layers_printed", "layers_scanned", "layer_command", "valid", "pattern", "height", "status")
    outputs_are_as_declared_from_the_start_on(lambda: FunctionComponent(contract_ports((2, 3), *names), step=step))
    for k, values in enumerate(given):
        assert values["time"].tolist() == [k * 10**9, 10**9]
        assert [int(values[name]) for name in (*names[:3], "status")] == [k, k, k, 0]
        assert values["valid"].all()
        assert values["pattern"].tolist() == [[1, 1, 1], [1, 1, 1]]
        np.testing.assert_allclose(values["height"], k * 1e-6 * np.arange(6).reshape(2, 3) / 5, rtol=1e-12)
    assert len(given) == 3
