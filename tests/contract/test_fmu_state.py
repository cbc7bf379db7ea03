"""Saved states, resets and many instances: a state is everything that the future depends on, bit by bit."""

from __future__ import annotations

import resource
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from support.fmus.fmu_driver import ERROR, EVERY_FORM, MODELS, OK, Driver, equal
from support.fmus.fmu_life import EVERY_MODEL, PARAMETERS, act, started


@EVERY_FORM
@EVERY_MODEL
@pytest.mark.parametrize("at", [6, 7, 8])
def test_run_replays_from_a_saved_state_bit_by_bit(model, form, at) -> None:
    """At 7 and 8 s a layer or scan is under way."""
    with started(model, form) as fmu, started(model, form, seed=2) as other:
        act(fmu, 0, at)
        saved = fmu.save()
        act(fmu, at, 14)
        end = fmu.save()
        assert saved != end
        for instance in (fmu, other):
            assert instance.restore(saved) == OK
            assert instance.save() == saved
            act(instance, at, 14)
            assert instance.save() == end


@pytest.mark.parametrize("model", ["LayerDeposition", "ProfileSensor"])
def test_large_grid_replays_from_a_saved_state(model: str) -> None:
    """Its working memory is taken and given back in every step; a scan that takes time is kept until its end."""
    large, other = (Driver(model, nx=280, ny=260) for _ in range(2))
    with large.start(PARAMETERS[model]) as fmu, other.start():
        act(fmu, 0, 7)
        saved = fmu.save()
        act(fmu, 7, 14)
        end, outputs = fmu.save(), fmu.outputs()
        assert saved != end
        assert other.restore(saved) == OK
        act(other, 7, 14)
        assert other.save() == end
        assert equal(other.outputs(), outputs)


@pytest.mark.skipif(sys.platform != "linux", reason="reads the resident memory where Linux shows it")
@pytest.mark.parametrize("model", ["LayerDeposition", "ProfileSensor"])
def test_maps_that_are_clear_take_no_memory_when_a_state_of_them_is_restored(model: str) -> None:
    """The system gives memory when it is first written; a run that resumes needs no more of it than any other."""
    side = 1500
    with Driver(model, nx=side, ny=side).start(PARAMETERS[model]) as fmu:
        state = fmu.fmu.getFMUState()
        before = resident_bytes()
        assert fmu.call("setFMUState", state) == OK
        assert resident_bytes() - before < side * side
        fmu.fmu.freeFMUState(state)


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@EVERY_MODEL
def test_state_of_one_version_of_the_standard_is_taken_by_the_other(model) -> None:
    with started(model, "fmi3") as three, started(model, "fmi2") as two, started(model, "fmi2", seed=3) as other:
        act(three, 0, 7)
        act(two, 0, 7)
        saved = three.save()
        assert two.save() == saved
        assert other.restore(saved) == OK
        for fmu in (three, two, other):
            act(fmu, 7, 13)
        assert three.save() == two.save() == other.save() != saved
        assert three.restore(saved) == OK
        assert three.save() == saved


@EVERY_FORM
def test_state_of_the_initialization_shows_its_own_start_values(form) -> None:
    """Its outputs are those of the start values that were set before it was saved, whatever came after."""
    with Driver("LayerDeposition", form, 5, 4) as fmu:
        assert fmu.enter(3.0) == OK
        assert fmu.set("height_start", 7e-6) == OK
        saved = fmu.save()
        assert (fmu.get("height") == 7e-6).all()
        assert fmu.save() == saved, "whether its outputs were read or not"
        assert fmu.set("height_start", 9e-6) == OK
        assert (fmu.get("height") == 9e-6).all()
        assert fmu.exit() == OK
        assert fmu.set("pitch", 1e-4) != OK
        assert fmu.restore(saved) == OK
        assert (fmu.get("height") == 7e-6).all()
        assert fmu.set("height_start", 8e-6) == OK, "in Initialization Mode again"
        assert (fmu.get("height") == 8e-6).all()
        assert fmu.exit() == OK
        assert fmu.step(3.0) == OK
        assert (fmu.get("height") == 8e-6).all()


MODES = ("instantiated", "initialization", "outdated", "step", "terminated")
"""Modes, and Initialization Mode with a start value that was set after its outputs were read."""


def in_mode(mode: str, form: str, start: float) -> Driver:
    """An instance on its way to a surface that is `start` high, in a mode."""
    fmu = Driver("LayerDeposition", form, 5, 4)
    assert fmu.set("height_start", start) == OK
    if mode != "instantiated":
        assert fmu.enter(0.0) == OK
    if mode == "outdated":
        assert (fmu.get("height") == start).all()
        assert fmu.set("height_start", 2 * start) == OK
    if mode in ("step", "terminated"):
        assert fmu.exit() == OK
        act(fmu, 0, 4)
    if mode == "terminated":
        assert fmu.call("terminate") == OK
    return fmu


@EVERY_FORM
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("saved_in", MODES)
def test_state_is_restored_into_every_mode(saved_in: str, mode: str, form: str) -> None:
    with in_mode(saved_in, form, 7e-6) as source, in_mode(mode, form, 3e-6) as fmu:
        saved = source.save()
        assert fmu.restore(saved) == OK
        if saved_in != "instantiated":  # when no output can be read yet
            assert equal(fmu.outputs(), source.outputs())
        assert fmu.save() == saved
        if saved_in == "instantiated":
            assert (fmu.enter(0.0), source.enter(0.0)) == (OK, OK)
        if saved_in in ("instantiated", "initialization", "outdated"):
            assert (fmu.exit(), source.exit()) == (OK, OK)
        if saved_in != "terminated":
            now = 4 if saved_in == "step" else 0
            act(fmu, now, now + 4)
            act(source, now, now + 4)
            assert equal(fmu.outputs(), source.outputs())
            assert fmu.save() == source.save() != saved
        assert fmu.set("height_start", 5e-6) != OK, "not in Step Mode"


@EVERY_FORM
@EVERY_MODEL
def test_states_in_memory_stand_beside_each_other(model, form) -> None:
    """Whatever becomes of the others: taken, restored twice, and freed in another order."""
    with started(model, form) as fmu:
        states, outputs, saved = [], [], []
        for at in range(0, 9, 3):
            act(fmu, at, at + 3)
            states.append(fmu.fmu.getFMUState())
            outputs.append(fmu.outputs())
            saved.append(fmu.save())
        assert len(set(saved)) == 3
        for number in (1, 0, 0, 2, 1):
            assert fmu.call("setFMUState", states[number]) == OK
            assert equal(fmu.outputs(), outputs[number])
            assert fmu.save() == saved[number]
            act(fmu, 3 * number + 3, 3 * number + 5)
        fmu.fmu.freeFMUState(states[1])
        for number in (2, 0):
            assert fmu.call("setFMUState", states[number]) == OK
            assert fmu.save() == saved[number]
            fmu.fmu.freeFMUState(states[number])


@EVERY_FORM
@EVERY_MODEL
def test_state_of_another_model_or_grid_and_a_damaged_one_are_refused(model, form) -> None:
    """Sizes and numbers in a state address memory: it is taken as it was saved, or not at all."""
    other = MODELS[MODELS.index(model) - 1]
    with (
        Driver(other, form, 5, 4) as alien,
        Driver(model, form) as larger,
        Driver(model, form, 4, 5) as turned,
        started(model, form) as fmu,
    ):
        act(fmu, 0, 4)
        before = fmu.save()
        wrong = [alien.save(), larger.save(), turned.save(), before[:-8], before + bytes(8), before[:10], b""]
        for number, place in enumerate(np.linspace(0, len(before) - 1, 200).astype(int)):
            wrong.append(before[:place] + bytes([before[place] ^ 1 << number % 8]) + before[place + 1 :])
        two_signs = bytearray(before)  # of two numbers, which a plain sum of words would miss
        two_signs[-1] ^= 0x80
        two_signs[-9] ^= 0x80
        for state in [*wrong, bytes(two_signs)]:
            fmu.messages.clear()
            assert fmu.restore(state) == ERROR
            assert fmu.messages
        assert fmu.save() == before


@EVERY_FORM
@EVERY_MODEL
def test_instances_in_parallel_threads_are_like_one_after_the_other(model, form) -> None:
    """ctypes lets go of Python's lock during a call, so the binaries do run at the same time."""

    def run(fmu: Driver) -> bytes:
        act(fmu, 0, 40)
        return fmu.save()

    together, alone = ([started(model, form, seed) for seed in range(8)] for _ in range(2))
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(run, together))
    assert found == [run(fmu) for fmu in alone]
    assert len(set(found)) == 8
    for fmu in (*together, *alone):
        fmu.fmu.freeInstance()
