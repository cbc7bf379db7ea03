"""Contract checks of every component of the loop, also for tests of your own components.

A check takes a function that makes a new component, and raises AssertionError with a message if the contract is broken.
With pytest:

    @pytest.mark.parametrize("check", CONTRACT_CHECKS)
    def test_my_component_keeps(check):
        check(lambda: Mine(job()))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import MEMBERS, Component, Job, Port, Values
from inkloop.contract import COUNTERS, PATTERN, VALID
from inkloop.units import M_PER_UM, NS_PER_S

WALL_CLOCK = frozenset({"solve_time"})
"""Outputs that may differ between two runs of the same bits."""

Maker: TypeAlias = Callable[[], Component]
ContractCheck: TypeAlias = Callable[[Maker], None]


def job(nx: int = 7, ny: int = 5, layers: int = 5) -> Job:
    """A small job: a block of `layers` nominal layers with one empty cell around it."""
    mask = np.zeros((nx, ny), dtype=np.bool_)
    mask[1:-1, 1:-1] = True
    height = layers * Job(nx, ny, 1e-4, np.zeros((nx, ny)), mask).inks[0].layer_height
    return Job(nx, ny, 1e-4, np.where(mask, height, 0.0), mask)


def it_is_a_component(make: Maker) -> None:
    """The component has the five required members."""
    with _made(make, 1) as (part,):
        missing = [name for name in MEMBERS if not hasattr(part, name)]
        assert not missing, f"{type(part).__name__} has no {', '.join(missing)}; a component has {', '.join(MEMBERS)}"


def names_of_ports_are_unique(make: Maker) -> None:
    """No two inputs and no two outputs share a name."""
    with _made(make, 1) as (part,):
        for ports in (part.inputs, part.outputs):
            names = [port.name for port in ports]
            assert len(set(names)) == len(names), f"a name occurs twice among {', '.join(names)}"


def outputs_are_as_declared_from_the_start_on(make: Maker) -> None:
    """`initialize` and every `do_step` return each declared output, in its shape and type, and no other."""
    with _made(make, 1) as (part,):
        _check_outputs(part, part.initialize(0, _starts(part)), "initialize")
        for k, outputs in enumerate(_steps(part, 0, 3)):
            _check_outputs(part, outputs, f"do_step {k}")


def same_inputs_give_the_same_bits(make: Maker) -> None:
    """Two components of the same kind agree to the last bit; randomness comes from the seed of the job."""
    with _made(make, 2) as parts:
        for part in parts:
            part.initialize(0, _starts(part))
        one, other = (_steps(part, 0, 4) for part in parts)
        _check_same(one, other, "a second component of the same kind")


def outputs_of_a_step_stay_as_they_were(make: Maker) -> None:
    """A later step does not write into arrays that an earlier one returned."""
    with _made(make, 1) as (part,):
        part.initialize(0, _starts(part))
        given = [part.do_step(k * NS_PER_S, NS_PER_S, _inputs(part, k)) for k in range(2)]
        copies = [_copied(values) for values in given]
        _steps(part, 2, 2)
        _check_same(copies, given, "the same arrays two steps later")


def inputs_are_left_alone(make: Maker) -> None:
    """Inputs are shared with other components and read-only."""
    with _made(make, 1) as (part,):
        part.initialize(0, _starts(part))
        inputs = _inputs(part, 0)
        for value in inputs.values():
            value.setflags(write=False)
        part.do_step(0, NS_PER_S, inputs)


def restored_component_continues_with_the_same_bits(make: Maker) -> None:
    """A second component that restores what the first one saved returns the same values as the first."""
    with _made(make, 2) as (part, other):
        for one in (part, other):
            assert hasattr(one, "save"), f"{type(one).__name__} has no save; a run with it cannot be resumed"
            assert hasattr(one, "restore"), f"{type(one).__name__} has no restore; a run with it cannot be resumed"
            one.initialize(0, _starts(one))
        _steps(part, 0, 2)
        other.restore(part.save())  # type: ignore[attr-defined]
        _check_same(_steps(part, 2, 3), _steps(other, 2, 3), "the restored one")


CONTRACT_CHECKS: tuple[ContractCheck, ...] = (
    it_is_a_component,
    names_of_ports_are_unique,
    outputs_are_as_declared_from_the_start_on,
    same_inputs_give_the_same_bits,
    outputs_of_a_step_stay_as_they_were,
    inputs_are_left_alone,
)
"""Checks for every component."""

RESUMABLE_CONTRACT_CHECKS = (*CONTRACT_CHECKS, restored_component_continues_with_the_same_bits)
"""Checks for components that offer `save` and `restore`, so that a run with them can be resumed."""


@contextmanager
def _made(make: Maker, count: int) -> Iterator[tuple[Component, ...]]:
    """New components, each terminated once at the end."""
    with ExitStack() as stack:
        parts = []
        for _ in range(count):
            part = make()
            if hasattr(part, "terminate"):
                stack.callback(part.terminate)
            parts.append(part)
        yield tuple(parts)


def _starts(part: Component) -> dict[str, NDArray[Any]]:
    return {port.name: port.start_value() for port in part.inputs}


def _inputs(part: Component, k: int) -> dict[str, NDArray[Any]]:
    """Inputs of the k-th second: k layers are commanded, printed and scanned; surfaces slope and grow."""
    return {port.name: _value(port, k) for port in part.inputs}


def _value(port: Port, k: int) -> NDArray[Any]:
    if port.name in COUNTERS:
        return np.asarray(k, port.dtype)
    if port.name in (VALID, PATTERN):
        return np.ones(port.shape, port.dtype)
    if port.dtype.startswith("float") and port.shape:
        return np.linspace(0, M_PER_UM * k, port.start_value().size, dtype=port.dtype).reshape(port.shape)
    return port.start_value()


def _steps(part: Component, first: int, count: int) -> list[Values]:
    return [_copied(part.do_step(k * NS_PER_S, NS_PER_S, _inputs(part, k))) for k in range(first, first + count)]


def _copied(values: Values) -> Values:
    return {name: np.array(value) for name, value in values.items()}


def _check_outputs(part: Component, outputs: Values, call: str) -> None:
    declared = {port.name for port in part.outputs}
    assert set(outputs) == declared, f"{call} returns {sorted(outputs)}; declared are {sorted(declared)}"
    for port in part.outputs:
        value = np.asarray(outputs[port.name])
        found, expected = (value.shape, value.dtype.name), (port.shape, port.dtype)
        assert found == expected, f"{call} returns {port.name} as {found}; declared is {expected}"


def _check_same(left: list[Values], right: list[Values], other: str) -> None:
    for k, (one, two) in enumerate(zip(left, right, strict=True)):
        for name in one.keys() - WALL_CLOCK:
            equal = np.array_equal(one[name], two[name], equal_nan=one[name].dtype.kind == "f")
            assert equal, f"{name} differs from that of {other} in step {k}"
