"""The measurements that the emulated nodes send."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest

from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.records import (
    CureMeasurement,
    HeadMeasurement,
    ProfilerMeasurement,
    Record,
    StageMeasurement,
    unpack,
)
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import CURE, HEAD, PROFILER, STAGE, NodeBench, heights

CODEC = Codec()
MEMORY = 64
"""Bytes: more than `Measurements` has."""


def test_measurements_come_as_often_as_the_dbc_says() -> None:
    memory = ctypes.create_string_buffer(MEMORY)
    names = ("HeadMeasurement", "StageMeasurement", "CureMeasurement", "ProfilerMeasurement")
    found: dict[int, list[int]] = {}
    with NodeBench() as bench:
        for now in range(0, 3001, 50):
            for node in range(len(names)):
                if frame := bench.measured(node, memory, now):
                    found.setdefault(frame.arbitration_id, []).append(now)
    cycles = {CODEC.message(name).frame_id: round(1e3 * (CODEC.cycle_time(name) or 0.0)) for name in names}
    assert found == {number: list(range(0, 3001, cycle)) for number, cycle in cycles.items()}


def measured(bench: NodeBench, node: int) -> Record:
    frame = bench.measured(node, ctypes.create_string_buffer(MEMORY), bench.clock)
    assert frame
    return unpack(CODEC, CODEC.decode(frame))


def test_head_counts_the_droplets_and_the_stage_stays() -> None:
    pattern = (np.arange(72).reshape(9, 8) % 3 != 0).astype(np.int32)
    with NodeBench() as bench:
        bench.ready()
        assert measured(bench, HEAD) == HeadMeasurement(40.0, -800.0, 0)
        for layer in (1, 2):
            bench.print_layer(pattern, layer)
        assert measured(bench, HEAD) == HeadMeasurement(40.0, -800.0, 2 * 48)
        assert measured(bench, STAGE) == StageMeasurement(0.0, 0.0, 0.0)


def lamp(bench: NodeBench) -> tuple[float, float, float]:
    """Irradiance [W/m2], temperature [degC], and time of the pulse [ms]."""
    record = measured(bench, CURE)
    assert isinstance(record, CureMeasurement)
    return record.irradiance, record.lamp_temperature, round(1e3 * record.lamp_time, 6)


def test_lamp_time_is_that_of_the_present_or_the_last_pulse() -> None:
    with NodeBench() as bench:
        bench.ready()
        assert lamp(bench) == (0.0, 30.0, 0.0)
        bench.raw(bench.routine(Routine.CURE, 1, option=b"\x01\x2c"), CURE)
        bench.tick(205)
        assert lamp(bench) == (1e4, 30.0, 200.0)
        bench.tick(200)
        assert lamp(bench) == (0.0, 30.0, 300.0)
        bench.tick(200)
        assert lamp(bench) == (0.0, 30.0, 300.0)


def test_profiler_counts_its_scans_and_the_cells_that_answered() -> None:
    def found(bench: NodeBench) -> Any:
        record = measured(bench, PROFILER)
        assert isinstance(record, ProfilerMeasurement)
        assert record.profiler_temperature == 25.0
        return record.scans, record.scan_progress, record.valid_share

    with NodeBench(dropout_rate=0.4, sensor_seed=3) as bench:
        bench.ready()
        assert found(bench) == (0, 0.0, 0.0)
        for number in (1, 2):
            bench.raw(bench.routine(Routine.SCAN, attempt=number), PROFILER)
            bench.tick()
            assert found(bench)[:2] == (number - 1, 0.0)
            bench.tick(100)
            valid = heights(bench.upload(0), 1e-7)[1]
            assert found(bench) == (number, 1.0, pytest.approx(valid.mean(), abs=0.0025))
            assert 0.3 < valid.mean() < 0.9
        bench.raw(bench.routine(Routine.SCAN, attempt=3), PROFILER)
        bench.tick(20)
        bench.stop(True)
        assert found(bench)[0] == 2, "a scan that was given up is none"
