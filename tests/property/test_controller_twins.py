"""For any job, options and print the controller FMU and the one in Python agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkloop.component import Component, Ink, Job, Status
from inkloop.components import catalog
from inkloop.geometry import PipeJunction
from inkloop_controller.model import LayerModel
from support.closed_loop import SECOND
from support.half_spaces import Above
from support.sheets import Sheets

OF_PYTHON_ALONE = {"bound", "bound_confidence", "gap", "planned_droplets", "solve_time"}
PITCH = 1e-4
PIPES = PipeJunction(4 * PITCH, 4 * PITCH, 3e-4, 10e-6, 2e-4, 6e-6, 20e-6)
TWO_INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


@dataclass(frozen=True)
class World:
    """Disturbances of a print unknown to controllers; seed of all random numbers."""

    seed: int
    noise: float  # of a reading [m]
    tilt: float  # of the scan's frame, more with each layer [m per cell]
    holes: float  # share of the cells that a scan does not see; the first one sees one cell in 50
    volume: float  # of the droplets, as a share of the nominal one
    dead_row: int  # no droplet of it comes from layer 3 on; -1: none
    unknown: frozenset[int]  # layers that were given up half way
    first_layer: int  # number of the layer on the substrate

    def inputs(self, height: Any, layer: int) -> dict[str, Any]:
        rng = np.random.default_rng((self.seed, layer))
        scan = height + rng.normal(0.0, self.noise, height.shape) + self.tilt * layer * np.indices(height.shape)[0]
        valid = rng.random(height.shape) >= self.holes
        if layer == 0:
            valid.flat[: valid.size // 50 + 1] = True
        return {
            "measured_height": scan,
            "valid": valid,
            "layers_scanned": np.asarray(self.first_layer + layer, np.int32),
            "layers_printed": np.asarray(self.first_layer + layer, np.int32),
            "layer_unknown": np.asarray(layer in self.unknown),
        }

    def printed(self, plant: LayerModel, height: Any, outputs: Any, layer: int) -> Any:
        """The surface after the layer that was commanded."""
        rng = np.random.default_rng((self.seed, layer, 1))
        row, _ = np.indices(height.shape)
        factor = self.volume * (1.0 - 0.3 * rng.random(height.shape)) * outputs["drop_level"]
        factor = np.where((row == self.dead_row) & (layer >= 3), 1e-12, factor)
        jetted = (
            np.where(row < len(height) // 2, outputs["pattern"], 0) if layer in self.unknown else outputs["pattern"]
        )
        return plant.layer(height, np.asarray(jetted, np.int32), self.first_layer + layer, factor)


# Where no scan sees a cell, its height is a sum of nominal droplets: regions that begin there, and end a hair above.
HEIGHTS = st.builds(lambda parts: parts * 0.05e-6 - 1e-15, st.integers(0, 500))
REGIONS = st.one_of(
    st.sampled_from([None, Above(5e-6), PIPES]),
    st.builds(
        Sheets,
        st.lists(HEIGHTS, min_size=1, max_size=4),
        st.sampled_from([2e-15, 1e-9, 0.5e-6]),
        st.sampled_from([0.0, 1e-3]),
    ),
)


@st.composite
def jobs(draw: st.DrawFn) -> Job:
    nx, ny = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mask = rng.random((nx, ny)) < draw(st.sampled_from([0.3, 0.9, 1.0]))
    if draw(st.booleans()):
        mask[:2], mask[-2:], mask[:, :2], mask[:, -2:] = False, False, False, False
    mask[nx // 2, ny // 2] = True
    target = np.where(mask, draw(st.sampled_from([0.0, 12e-6, 30e-6])) + rng.uniform(0.0, 5e-6, (nx, ny)), 0.0)
    region = draw(REGIONS)
    return Job(
        nx,
        ny,
        PITCH,
        target,
        mask,
        inks=TWO_INKS if region else TWO_INKS[: draw(st.integers(1, 2))],
        region=region,
        passes=draw(st.sampled_from([1, 4])),
        pass_order=draw(st.integers(1, 2)),
        pass_rotation=draw(st.integers(0, 3)),
        seed=draw(st.integers(0, 2**31 - 1)),
    )


@st.composite
def options(draw: st.DrawFn) -> dict[str, Any]:
    """Those that both controllers call by the same names."""
    drawn = {
        "alpha": st.sampled_from([0.0, 0.3, 0.8, 1.0]),
        "finish": st.sampled_from(["even", "fast"]),
        "horizon": st.integers(1, 4),
        "overshoot": st.sampled_from([0.5, 1.0, 4.0]),
        "overshoot_limit_um": st.sampled_from([0.0, 2.0]),
        "chance_margin": st.sampled_from([0.0, 2.0]),
        "fringe_weight": st.sampled_from([0.0, 0.4, 1.0]),
        "droplet_std": st.sampled_from([0.0, 0.3]),
        "layer_worth": st.sampled_from([0.0, 0.05]),
        "region_test": st.sampled_from(["middle", "surface", "either"]),
        "drop_levels": st.integers(1, 3),
        "iterations": st.integers(1, 5),
        "annealing_sweeps": st.integers(0, 2),
        "adapt_ink": st.sampled_from(["scale", "full", "off"]),
        "sensor_noise_std_um": st.sampled_from([0.0, 1.0]),
        "sensor_resolution_um": st.sampled_from([0.0, 0.5]),
        "untrusted_layers": st.integers(0, 3),
    }
    found = {name: draw(values) for name, values in drawn.items() if draw(st.booleans())}
    return {"annealing_sweeps": 1, **found}  # the default is up to 200 for parts as small as these


WORLDS = st.builds(
    World,
    seed=st.integers(0, 2**32 - 1),
    noise=st.sampled_from([0.0, 1e-6]),
    tilt=st.sampled_from([0.0, 0.1e-6]),
    holes=st.sampled_from([0.0, 0.2, 1.0]),
    volume=st.sampled_from([0.6, 1.0, 1.3]),
    dead_row=st.integers(-1, 4),
    unknown=st.frozensets(st.integers(1, 6), max_size=2),
    first_layer=st.sampled_from([0, 41]),
)


def with_unseen(inputs: dict[str, Any], reading: float) -> dict[str, Any]:
    """A scan whose cells that were not seen hold some reading."""
    return {**inputs, "measured_height": np.where(inputs["valid"], inputs["measured_height"], reading)}


def moved(job: Job, chosen: dict[str, Any], saved: bytes) -> Component:
    """Another instance that continues from a saved state."""
    controller = catalog.make("LayerController", job, chosen)
    controller.initialize(0, World(0, 0.0, 0.0, 0.0, 1.0, -1, frozenset(), 0).inputs(np.zeros((job.nx, job.ny)), 0))
    controller.restore(saved)  # type: ignore[attr-defined]
    return controller


def assert_twins(job: Job, chosen: dict[str, Any], dead: set[int], world: World, layers: int) -> None:
    """The same outputs after every scan, the FMU in another instance each time."""
    alive = np.broadcast_to(~np.isin(np.arange(job.ny), list(dead)), (job.nx, job.ny))
    for_python = {**chosen, "sweeps": 3, "dead_nozzles": sorted(dead)}
    for_fmu = {**chosen, "sweeps_max": 3, "jettable": alive.tolist()}
    python, fmu = catalog.make("LayerMpc", job, for_python), catalog.make("LayerController", job, for_fmu)
    plant, height = LayerModel.of(job), np.zeros((job.nx, job.ny))
    for controller in (python, fmu):
        controller.initialize(0, world.inputs(height, 0))
    for layer in range(layers):
        inputs = world.inputs(height, layer)
        one = python.do_step(layer * SECOND, SECOND, with_unseen(inputs, np.nan))
        other = fmu.do_step(layer * SECOND, SECOND, with_unseen(inputs, 0.3))
        for name in one.keys() - OF_PYTHON_ALONE:
            np.testing.assert_array_equal(one[name], other[name], err_msg=f"{name} after scan {layer}")
        if one["status"] == Status.DONE:
            break
        saved = fmu.save()  # type: ignore[attr-defined]
        fmu.terminate()
        fmu = moved(job, for_fmu, saved)
        height = world.printed(plant, height, one, layer + 1)
    fmu.terminate()


def test_unseen_surface_at_the_height_of_a_thin_region_is_planned_alike() -> None:
    """Two drops of ink B on each of three cells fill the middle one to 10 um: at a pipe's side only that is in it."""
    target = np.array([[30.0e-6, 34.0e-6, 34.5e-6]])
    job = Job(1, 3, PITCH, target, np.ones((1, 3), np.bool_), inks=TWO_INKS, region=PIPES)
    chosen = {"region_test": "surface", "drop_levels": 2, "horizon": 1, "annealing_sweeps": 1}
    unseen = World(0, noise=0.0, tilt=0.0, holes=1.0, volume=0.6, dead_row=-1, unknown=frozenset(), first_layer=0)
    assert_twins(job, chosen, set(), unseen, layers=3)


def test_limit_with_a_margin_is_planned_alike_where_scans_are_corrected() -> None:
    """The margin grows with the uncertainty of their displacement. All nozzles are dead from layer 3 on."""
    target = 12e-6 + np.random.default_rng(0).uniform(0.0, 5e-6, 10).reshape(2, 5)[1:]
    job = Job(1, 5, PITCH, target, np.ones((1, 5), np.bool_), inks=TWO_INKS, region=Above(5e-6))
    chosen = {"annealing_sweeps": 1, "overshoot_limit_um": 0.0, "chance_margin": 2.0}
    world = World(0, noise=1e-6, tilt=0.0, holes=0.0, volume=0.6, dead_row=0, unknown=frozenset(), first_layer=41)
    assert_twins(job, chosen, set(), world, layers=12)


@given(job=jobs(), chosen=options(), world=WORLDS, data=st.data())
@settings(max_examples=15)
def test_controller_fmu_answers_every_scan_as_the_python_controller(
    job: Job, chosen: dict[str, Any], world: World, data: st.DataObject
) -> None:
    dead = data.draw(st.sets(st.integers(0, job.ny - 1), max_size=2))
    assert_twins(job, chosen, dead, world, layers=7)


@pytest.mark.long
@given(job=jobs(), chosen=options(), world=WORLDS, data=st.data())
@settings(max_examples=400)
def test_controller_fmu_answers_hundreds_of_prints_as_the_python_controller(
    job: Job, chosen: dict[str, Any], world: World, data: st.DataObject
) -> None:
    dead = data.draw(st.sets(st.integers(0, job.ny - 1), max_size=2))
    assert_twins(job, chosen, dead, world, layers=12)
