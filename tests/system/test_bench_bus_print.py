"""A print through BenchBus.fmu is that over an adapter, and the bus carries the same messages."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from inkloop.cli import main
from inkloop.fmu.bus import BusFrame, transmit
from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop_hardware.protocol.codec import Codec, Frame
from support.benches.bench_run import BLOCK, FAST, assert_same_print, emulated, printed_with_fmus, write
from support.fmus.bus_driver import BusDriver

ONE_LAYER = {"part.height_um": 3.0}
REQUESTS = range(0x640, 0x648)
STATUSES = range(0x101, 0x105)
PHASE = ("State", "Layer", "PassMask", "LampOn", "GateOpen", "GateClosed")
COURSE: list[tuple[float, float]] = [(0, 0), *((1, (1 << passes) - 1) for passes in range(5))]
"""Layer and mask of the passes done, of a print of one layer; the head alone counts passes."""
JOURNAL = b"\x62\x01\x00"
JOB_1 = b"\0\0\0\1"
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
    """The messages of each identifier, put together of their frames, as of job 1, which that through an FMU has."""
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
        number: [timeless(one.replace(job, JOB_1)) for one in of_it if not PENDING.fullmatch(one)]
        for number, of_it in found.items()
    }


def timeless(message: bytes) -> bytes:
    """A journal has times of the node's clock in it: its length only."""
    return bytes(len(message)) if message.startswith(JOURNAL) else message


Phase = tuple[int, tuple[float, ...]]


def states(log: Path) -> dict[Phase, tuple[float, ...]]:
    """The status frames by node and phase, each of which has one content; the progress of a node follows COURSE.

    A node sends its status every 100 ms of its own clock, so the clock of the master decides which phases a log has.
    """
    codec, found = Codec(), dict[Phase, tuple[float, ...]]()
    course: dict[int, list[int]] = {}
    for frame in can.BLFReader(log):
        if frame.arbitration_id in STATUSES:
            reading = codec.decode(Frame(frame.arbitration_id, bytes(frame.data)))
            assert reading.intact
            course.setdefault(frame.arbitration_id, []).append(
                COURSE.index((reading.values["Layer"], reading.values["PassMask"]))
            )
            phase = frame.arbitration_id, tuple(reading.values[name] for name in PHASE)
            content = tuple(value for name, value in reading.values.items() if name not in PHASE)
            assert found.setdefault(phase, content) == content
    assert course.keys() == set(STATUSES)
    assert all(met == sorted(met) for met in course.values())
    return found


def assert_outputs_are_those_of_the_print(file: Path, log: Path, print_: Any) -> None:
    """The FMU answers the frames of the master once more as it did, and shows what happens below its nodes."""
    folder = file.with_suffix("")
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder)
    logged = list(can.BLFReader(log))
    given: dict[int, bytes] = {}  # by millisecond
    for frame in logged:
        if not frame.is_rx:
            at = int(1e3 * frame.timestamp + 0.5)
            given[at] = given.get(at, b"") + transmit(BusFrame(frame.arbitration_id, bytes(frame.data)))
    last = max(given) + 1
    lamp, gate, jetted = [], [], []
    with BusDriver("fmi3-fixed", 12, 11, folder).begin(**FAST) as bench:
        for at in range(last):
            bench.go(0.001, given.get(at, b""))
            lamp.append(bool(bench.get("lamp_on")))
            gate.append(bool(bench.get("gate_open")))
            jetted.append(int(bench.get("droplets")))
        received = [frame.arbitration_id for frame in logged if frame.is_rx]
        assert [frame.identifier for frame in bench.frames()][: len(received)] == received
        assert not np.logical_and(lamp, gate).any()
        passes = [
            np.count_nonzero(np.diff(np.concatenate([[0], of_it, [0]]).astype(int)) > 0) for of_it in (lamp, gate)
        ]
        assert passes == [4, 4]
        grows = np.diff(jetted) > 0
        assert set(np.array(gate)[1:][grows] | np.array(gate)[:-1][grows]) == {True}
        droplets = np.count_nonzero(print_.pattern)
        assert (bench.get("droplets"), bench.get("scans"), bench.get("lamp_with_gate")) == (droplets, 2, 0)
        surface, seen = bench.get("surface_height"), print_.valid.values[-1]
        off = (print_.measured_height.values[-1] - surface)[seen]
        assert 0.0 < np.abs(off).max() < 1e-6
        assert surface.max() > 3e-6


def test_print_through_the_fmu_is_that_on_the_emulator(tmp_path: Path) -> None:
    """And that with the FMUs of printer and profiler, to the bit; requests, answers and the content of states agree."""
    path = write(tmp_path)
    logs: Mapping[str, Path] = {name: tmp_path / name / "traffic.blf" for name in ("fmu", "slcan")}
    found = print_part(Scenario.load(path, {**through(exported(path)), **ONE_LAYER}), folder=logs["fmu"].parent)
    assert_same_print(found, printed_with_fmus(path, ONE_LAYER))
    assert found.dataset.pattern.values.any()
    with emulated(path, ONE_LAYER) as (_, channel):
        on_emulator = {"bench.interface": "slcan", "bench.channel": channel}
        print_part(Scenario.load(path, {**on_emulator, **ONE_LAYER}), folder=logs["slcan"].parent)
    assert_outputs_are_those_of_the_print(path.with_name("bench.fmu"), logs["fmu"], found.dataset)
    assert messages(logs["fmu"]) == messages(logs["slcan"])
    ours, theirs = states(logs["fmu"]), states(logs["slcan"])
    both = ours.keys() & theirs.keys()
    assert {number for number, _ in both} == set(STATUSES)
    assert [ours[phase] for phase in both] == [theirs[phase] for phase in both]


def test_prints_through_the_fmu_repeat_frame_by_frame(tmp_path: Path) -> None:
    """With their times, to the byte of the log, also where frames are lost; the log can be replayed."""
    path, folders = write(tmp_path), [tmp_path / name for name in ("one", "other")]
    given = "".join(f", {name} = {value}" for name, value in FAST.items())
    lossy = f'options.parameters = {{ faults = "loss:probability=1e-2"{given} }}'
    bench = f'interface = "inkloop_fmu"\nchannel = "{exported(path)}"\n{lossy}\n'
    write(tmp_path, BLOCK.replace('interface = "slcan"\n', bench))
    for folder in folders:
        words = ["--no-pictures", "--quiet", "--set", "part.height_um=3.0", "--out", str(folder)]
        assert main(["run", str(path), *words]) == 0
    one, other = ((folder / "traffic.blf").read_bytes() for folder in folders)
    assert one == other
    times = [frame.timestamp for frame in can.BLFReader(folders[0] / "traffic.blf")]
    assert times == sorted(times)
    assert times[0] == 0.0
    assert main(["bench", "replay", str(folders[0]), "--quiet"]) == 0


@pytest.mark.parametrize("name", ["none.fmu", "block.toml"])
def test_channel_that_is_no_bench_is_named(name, tmp_path: Path) -> None:
    path = write(tmp_path)
    words = f"inkloop_fmu on {tmp_path}/{name} .*cannot be opened.* from the scenario's folder"
    with pytest.raises(Exception, match=words):
        print_part(Scenario.load(path, {**through(tmp_path / name), **ONE_LAYER}), folder=tmp_path / "run")
