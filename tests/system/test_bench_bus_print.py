"""A print through BenchBus.fmu is that over an adapter, and the bus carries the same messages."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import can
import pytest

from inkloop.cli import main
from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop_hardware.protocol.codec import Codec, Frame
from support.benches.bench_run import FAST, assert_same_print, emulated, printed_with_fmus, write

ONE_LAYER = {"part.height_um": 3.0}
REQUESTS = range(0x640, 0x648)
STATUSES = range(0x101, 0x105)
LASTING = ("Fault", "BootCount", "UnknownMask", "ProtocolVersion")
COURSE: list[tuple[float, float]] = [(0, 0), *((1, (1 << passes) - 1) for passes in range(5))]
"""Layer and mask of the passes done, of a print of one layer; the head alone counts passes."""
JOURNAL = b"\x62\x01\x00"
PENDING = re.compile(b"\x7f.\x78", re.DOTALL)
"""A node that is still busy says so each second of the clock: not counted."""


def through(file: Path) -> dict[str, Any]:
    """The three words of [bench] that lead a run to an FMU, which stands where its scenario does."""
    return {"bench.interface": "inkloop_fmu", "bench.channel": file.name, "bench.options": {"parameters": FAST}}


def exported(path: Path) -> Path:
    file = path.with_name("bench.fmu")
    assert main(["export", "bench", str(path), "--set", "part.height_um=3.0", "--out", str(file), "--quiet"]) == 0
    return file


def messages(log: Path) -> dict[int, list[bytes]]:
    """The messages of each identifier, put together of their frames, without the number of the job."""
    found: dict[int, list[bytes]] = {}
    lengths: dict[int, int] = {}
    for frame in can.BLFReader(log):
        number, data = frame.arbitration_id, bytes(frame.data)
        if number not in REQUESTS:
            continue
        of_it = found.setdefault(number, [])
        match data[0] >> 4:
            case 0:
                of_it.append(data[1 : 1 + data[0]])
            case 1:
                lengths[number] = (data[0] & 0xF) << 8 | data[1]
                of_it.append(data[2:])
            case 2:
                of_it[-1] = (of_it[-1] + data[1:])[: lengths[number]]
    (job,) = {one[4:8] for one in found[0x640] if one[:2] == b"\x31\x01" and len(one) >= 8}
    return {
        number: [timeless(one.replace(job, b"JOB!")) for one in of_it if not PENDING.fullmatch(one)]
        for number, of_it in found.items()
    }


def timeless(message: bytes) -> bytes:
    """A journal has times of the node's clock in it: its length only."""
    return bytes(len(message)) if message.startswith(JOURNAL) else message


def states(log: Path) -> dict[int, tuple[set[float], ...]]:
    """Cause, boots, unknown cells and version in the status frames of each node, whose progress follows COURSE.

    The frames of two runs are not the same: a node sends its status every 100 ms of its own clock, a pass takes 2 ms,
    and the clock of the master decides which states a frame meets. What it meets comes in one order.
    """
    codec, found = Codec(), dict[int, list[Mapping[str, float]]]()
    for frame in can.BLFReader(log):
        if frame.arbitration_id in STATUSES:
            reading = codec.decode(Frame(frame.arbitration_id, bytes(frame.data)))
            assert reading.intact
            found.setdefault(frame.arbitration_id, []).append(reading.values)
    for number, readings in found.items():
        met = [COURSE.index((values["Layer"], values["PassMask"])) for values in readings]
        assert met == sorted(met), f"{number:#x}"
    return {number: tuple({each[name] for each in readings} for name in LASTING) for number, readings in found.items()}


def test_print_through_the_fmu_is_that_on_the_emulator(tmp_path: Path) -> None:
    """And that with the FMUs of printer and profiler, to the bit; requests, answers and the course of states agree."""
    path = write(tmp_path)
    logs: Mapping[str, Path] = {name: tmp_path / name / "traffic.blf" for name in ("fmu", "slcan")}
    found = print_part(Scenario.load(path, {**through(exported(path)), **ONE_LAYER}), folder=logs["fmu"].parent)
    assert_same_print(found, printed_with_fmus(path, ONE_LAYER))
    assert found.dataset.pattern.values.any()
    with emulated(path, ONE_LAYER) as (_, channel):
        on_emulator = {"bench.interface": "slcan", "bench.channel": channel}
        print_part(Scenario.load(path, {**on_emulator, **ONE_LAYER}), folder=logs["slcan"].parent)
    assert messages(logs["fmu"]) == messages(logs["slcan"])
    assert states(logs["fmu"]) == states(logs["slcan"])
    assert states(logs["fmu"]).keys() == set(STATUSES)


@pytest.mark.parametrize("name", ["none.fmu", "block.toml"])
def test_channel_that_is_no_bench_is_named(name, tmp_path: Path) -> None:
    path = write(tmp_path)
    words = f"inkloop_fmu on {tmp_path}/{name} .*cannot be opened.* from the scenario's folder"
    with pytest.raises(Exception, match=words):
        print_part(Scenario.load(path, {**through(tmp_path / name), **ONE_LAYER}), folder=tmp_path / "run")
