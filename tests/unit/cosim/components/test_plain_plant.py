"""A plant without the handshake prints one layer for each command and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from inkloop.component import Job, Port, Values
from inkloop.components import catalog
from inkloop.components.plain_plant import PlainPlant
from inkloop.errors import ComponentError, ScenarioError
from inkloop.fmu import FmuComponent
from inkloop.testing import CONTRACT_CHECKS, RESUMABLE_CONTRACT_CHECKS, ContractCheck
from support.fmus.amplifier import build
from support.toys import DROPLET, FunctionComponent, toy_job

SECOND = 1_000_000_000
FLAT = toy_job(nx=3, ny=1)


class Heap:
    """Adds a droplet wherever its input is 1, in every step; heights in micrometres."""

    def __init__(self, job: Job) -> None:
        shape = (job.nx, job.ny)
        self.inputs = (Port("dots", shape=shape), Port("temperature", "K", start=300.0))
        self.outputs = (Port("surface", "um", shape), Port("fumes"))
        self.times: list[tuple[int, int]] = []
        self._surface = np.zeros(shape)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._outputs(inputs)

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        self.times.append((time_ns, step_ns))
        self._surface = self._surface + DROPLET * 1e6 * inputs["dots"]
        return self._outputs(inputs)

    def terminate(self) -> None: ...

    def _outputs(self, inputs: Values) -> Values:
        return {"surface": self._surface, "fumes": np.array(inputs["temperature"])}


def heap(job: Job) -> tuple[Heap, PlainPlant]:
    plant = Heap(job)
    return plant, PlainPlant(job, plant, pattern_input="dots", height_output="surface")


def inputs(job: Job, command: int, dots: int = 1) -> Values:
    pattern = np.full((job.nx, job.ny), dots, np.int32)
    return {"pattern": pattern, "layer_command": np.asarray(command, np.int32), "temperature": np.asarray(310.0)}


@pytest.mark.parametrize("check", CONTRACT_CHECKS)
def test_plain_plant_of_python_keeps(check: ContractCheck) -> None:
    check(lambda: heap(toy_job())[1])


@pytest.mark.compiled
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
def test_plain_plant_of_a_foreign_fmu_keeps(check: ContractCheck, fmi: int, tmp_path: Path) -> None:
    check(lambda: PlainPlant(FLAT, FmuComponent(build(tmp_path, fmi)), pattern_input="x", height_output="y"))


def test_droplets_that_the_plant_cannot_count_are_refused() -> None:
    plant = FunctionComponent(
        [Port("dots", shape=(3, 1), dtype="bool")],
        [Port("surface", "um", (3, 1))],
        lambda time_ns, step_ns, inputs: {"surface": inputs["dots"] * 1.0},
    )
    part = PlainPlant(FLAT, plant, pattern_input="dots", height_output="surface")
    part.initialize(0, inputs(FLAT, 0))
    assert part.do_step(0, SECOND, inputs(FLAT, 1))["height"].tolist() == [[1e-6]] * 3
    with pytest.raises(ComponentError, match="dots is 2; needs 0 or 1"):
        part.do_step(SECOND, SECOND, inputs(FLAT, 2, dots=2))


@pytest.mark.compiled
def test_scenario_names_the_plant_its_ports_and_its_parameters(tmp_path: Path) -> None:
    options = {"file": str(build(tmp_path, 2)), "pattern_input": "x", "height_output": "y", "gain": 3.0}
    part = catalog.make("PlainPlant", FLAT, options)
    part.initialize(0, {**inputs(FLAT, 0), "on": np.array(True)})
    assert part.do_step(0, SECOND, inputs(FLAT, 1))["height"].tolist() == [[3.0]] * 3
    part.terminate()


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pattern_input": 3}, "pattern_input is 3; expected the name of a port"),
        ({"gian": 3.0}, "gian is no option of Amplifier; did you mean gain?"),
        ({"height_output": "z"}, "height_output is 'z', which the plant does not have"),
        ({"plant": "PlainPlant"}, "plant is 'PlainPlant'; expected a kind"),
        ({"plant": "Nowhere"}, "kind is 'Nowhere'; known: "),
    ],
)
def test_error_of_the_scenario_is_reported(changes: dict[str, object], message: str, tmp_path: Path) -> None:
    options = {"file": str(build(tmp_path, 2)), "pattern_input": "x", "height_output": "y", **changes}
    assert any(error.startswith(message) for error in catalog.check("PlainPlant", FLAT, options).errors)
    with pytest.raises(ScenarioError, match=r"(?s)PlainPlant.*error"):
        catalog.make("PlainPlant", FLAT, options)


def test_each_command_is_one_step_of_the_plant_on_a_clock_of_its_own() -> None:
    job = toy_job()
    plant, part = heap(job)
    assert int(part.initialize(3 * SECOND, inputs(job, 4))["layers_printed"]) == 4
    for command in (6, 3):
        with pytest.raises(ComponentError, match=f"layer_command is {command} after layer 4; needs 4 or 5"):
            part.do_step(0, SECOND, inputs(job, command))
    found = [part.do_step(k * SECOND, SECOND, inputs(job, command)) for k, command in enumerate([4, 5, 5, 5, 6])]
    assert [int(values["layers_printed"]) for values in found] == [4, 5, 5, 5, 6]
    assert plant.times == [(3 * SECOND, SECOND), (4 * SECOND, SECOND)]
    np.testing.assert_allclose(found[1]["height"], DROPLET, rtol=1e-12)  # in metres
    assert float(found[1]["fumes"]) == 310.0  # handed through
    with pytest.raises(ComponentError, match="the plant cannot save its state"):
        part.save()


def test_flat_arrays_have_the_cells_of_the_map_in_their_order() -> None:
    job = toy_job()
    plant = FunctionComponent(
        [Port("dots", shape=(12,))],
        [Port("surface", "um", (12,))],
        lambda time_ns, step_ns, inputs: {"surface": inputs["dots"] * 1.0},
    )
    part = PlainPlant(job, plant, pattern_input="dots", height_output="surface")
    part.initialize(0, inputs(job, 0))
    pattern = np.arange(12, dtype=np.int32).reshape(4, 3)
    values = part.do_step(0, SECOND, {**inputs(job, 1), "pattern": pattern})
    np.testing.assert_allclose(values["height"], pattern * 1e-6, rtol=1e-12)


class KeptHeap(Heap):
    """One that can be saved."""

    def save(self) -> bytes:
        return self._surface.tobytes()

    def restore(self, state: bytes) -> None:
        self._surface = np.frombuffer(state).reshape(self._surface.shape)


def test_restored_plant_goes_on_at_its_own_time() -> None:
    job = toy_job()
    first, other = (PlainPlant(job, KeptHeap(job), pattern_input="dots", height_output="surface") for _ in "ab")
    for part in (first, other):
        part.initialize(0, inputs(job, 0))
    for command in (1, 2):
        first.do_step(9 * SECOND, SECOND, inputs(job, command))
    other.restore(first.save())
    assert float(other.do_step(8 * SECOND, SECOND, inputs(job, 2))["height"].max()) == pytest.approx(
        2 * DROPLET, rel=1e-9, abs=0.0
    )  # no new layer: the outputs saved
    assert float(other.do_step(9 * SECOND, SECOND, inputs(job, 3))["height"].max()) == pytest.approx(
        3 * DROPLET, rel=1e-9, abs=0.0
    )
    assert other._plant.times == [(2 * SECOND, SECOND)]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("outputs", "ports", "message"),
    [
        (
            [],
            {"pattern_input": "dot", "height_output": "top"},
            "pattern_input is 'dot', .*; height_output is 'top', wh",
        ),
        ([Port("height")], {}, r"height_output is 'height' of shape \(\); needs 4 x 3 values"),
        ([Port("height", "K", (4, 3))], {}, r"which is in \[K\]; needs a length"),
        ([Port("height", "m", (4, 3)), Port("layers_printed")], {}, "plant has layers_printed of its own"),
    ],
)
def test_plant_that_is_none_is_refused(outputs: list[Port], ports: dict[str, str], message: str) -> None:
    plant = FunctionComponent(inputs=[Port("pattern", shape=(4, 3))], outputs=outputs)
    with pytest.raises(ValueError, match=message):
        PlainPlant(toy_job(), plant, **ports)
