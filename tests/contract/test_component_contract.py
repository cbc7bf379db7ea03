"""What every component of the loop keeps, whatever it is made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from amplifier import build
from inkloop import catalog
from inkloop.component import Component, Values
from inkloop.fmu import FmuComponent
from toys import toy_job

SECOND = 1_000_000_000
JOB = toy_job(nx=7, ny=5)
FORMS = ("fmi3", "fmi3-fixed", "fmi2")
MAKERS: dict[str, Callable[[Path], Component]] = {
    **{
        f"LayerDeposition {form}": lambda _, form=form: catalog.make("LayerDeposition", JOB, {"fmi": form})
        for form in FORMS
    },
    **{
        f"ProfileSensor {form}": lambda _, form=form: catalog.make(
            "ProfileSensor", JOB, {"fmi": form, "noise_std_um": 0.5}
        )
        for form in FORMS
    },
    **{kind: lambda _, kind=kind: catalog.make(kind, JOB, {}) for kind in catalog.PYTHON_KINDS},
    "foreign FMI 2": lambda folder: FmuComponent(build(folder, 2)),
    "foreign FMI 3": lambda folder: FmuComponent(build(folder, 3)),
}


@pytest.fixture(params=MAKERS)
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Callable[[], Component]]:
    """Makes components of one kind and terminates them."""
    made: list[Component] = []

    def one() -> Component:
        made.append(MAKERS[request.param](tmp_path))
        return made[-1]

    yield one
    for part in made:
        part.terminate()


def starts(part: Component) -> Values:
    return {port.name: port.start_value() for port in part.inputs}


def assert_as_declared(part: Component, outputs: Values) -> None:
    assert set(outputs) == {port.name for port in part.outputs}
    for port in part.outputs:
        assert np.asarray(outputs[port.name]).shape == port.shape, port.name
        assert np.asarray(outputs[port.name]).dtype == port.dtype, port.name


def steps(part: Component, first: int, count: int) -> list[Values]:
    """Steps of one second; the layer after the printed one is scanned, commanded and jetted by turns."""
    found = []
    for k in range(first, first + count):
        inputs = dict(starts(part))
        counters = {"layers_printed": k, "layers_scanned": k, "layer_command": k}
        for name in counters.keys() & inputs.keys():
            inputs[name] = np.asarray(counters[name], inputs[name].dtype)
        for name in {"valid"} & inputs.keys():
            inputs[name] = np.ones_like(inputs[name])
        for name in {"height", "measured_height", "x"} & inputs.keys():
            inputs[name] = np.linspace(0, 1e-6 * k, inputs[name].size).reshape(inputs[name].shape)
        found.append({name: np.array(value) for name, value in part.do_step(k * SECOND, SECOND, inputs).items()})
    return found


def test_is_a_component(make: Callable[[], Component]) -> None:
    assert isinstance(make(), Component)


def test_names_of_ports_are_unique(make: Callable[[], Component]) -> None:
    part = make()
    for ports in (part.inputs, part.outputs):
        assert len({port.name for port in ports}) == len(ports)


def test_outputs_are_as_declared_from_the_start_on(make: Callable[[], Component]) -> None:
    part = make()
    assert_as_declared(part, part.initialize(0, starts(part)))
    for outputs in steps(part, 0, 3):
        assert_as_declared(part, outputs)


def test_same_inputs_give_the_same_bits(make: Callable[[], Component]) -> None:
    runs = []
    for part in (make(), make()):
        part.initialize(0, starts(part))
        runs.append(steps(part, 0, 4))
    assert_same(*runs)


def test_restored_component_goes_on_with_the_same_bits(make: Callable[[], Component]) -> None:
    part, other = make(), make()
    for one in (part, other):
        one.initialize(0, starts(one))
    steps(part, 0, 2)
    other.restore(part.save())  # type: ignore[attr-defined]
    assert_same(steps(part, 2, 3), steps(other, 2, 3))


def test_inputs_are_left_alone(make: Callable[[], Component]) -> None:
    part = make()
    part.initialize(0, starts(part))
    inputs = starts(part)
    for value in inputs.values():
        value.setflags(write=False)
    part.do_step(0, SECOND, inputs)


def assert_same(left: list[Values], right: list[Values]) -> None:
    for k, (one, other) in enumerate(zip(left, right, strict=True)):
        for name in one.keys() - {"solve_time"}:
            np.testing.assert_array_equal(one[name], other[name], err_msg=f"{name} at step {k}")
