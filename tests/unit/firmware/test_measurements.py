"""The measurements that the emulated nodes send."""

from __future__ import annotations

import ctypes

from inkloop_hardware.protocol.codec import Codec
from support.benches.node_bench import NodeBench

CODEC = Codec()
MEMORY, FRAME = 64, 32
"""Bytes: more than `Measurements` and a `CanFrame` have."""


def test_measurements_come_as_often_as_the_dbc_says() -> None:
    memory, frame = (ctypes.create_string_buffer(size) for size in (MEMORY, FRAME))
    names = ("HeadMeasurement", "StageMeasurement", "CureMeasurement", "ProfilerMeasurement")
    found: dict[int, list[int]] = {}
    with NodeBench() as bench:
        for now in range(0, 3001, 50):
            for node in range(len(names)):
                if bench.c.measurements_next(memory, bench.bench, node, ctypes.c_uint32(now), frame) & 1:
                    found.setdefault(int.from_bytes(frame.raw[:4], "little"), []).append(now)
    cycles = {CODEC.message(name).frame_id: round(1e3 * (CODEC.cycle_time(name) or 0.0)) for name in names}
    assert found == {number: list(range(0, 3001, cycle)) for number, cycle in cycles.items()}
