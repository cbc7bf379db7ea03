"""`inkloop bench doctor` on a bench between processes, with one piece after the other missing or wrong."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from inkloop.bench.commands import emulation_of
from inkloop.cli import main
from inkloop.scenario.file import Scenario
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor.listening import Heard, listen
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import Fault, MasterAlive, Node, NodeStatus, State, pack
from support.benches.bench_run import BLOCK, FAST, write

CODEC = Codec()
DEAD = [f"death:node={node.lower()}" for node in Node]
Doctor = Callable[..., tuple[int, dict[str, str]]]


@contextmanager
def bench(path: Path, *faults: str) -> Iterator[str]:
    """The bench of a scenario with injected faults; its channel."""
    emulation = emulation_of(Scenario.load(path))
    with EmulatedBench(emulation.parameters | FAST, surface=emulation.surface, faults=faults) as running:
        yield running.channel


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path)


@pytest.fixture
def doctor(path: Path, capsys: pytest.CaptureFixture[str]) -> Doctor:
    """Looks over the bench at a channel: the exit code, and the finding of each check with an error."""

    def look(channel: str, *words: str) -> tuple[int, dict[str, str]]:
        code = main(["bench", "doctor", str(path), "--json", "--set", f"bench.channel={channel}", *words])
        report = json.loads(capsys.readouterr().out)
        assert report["exit_code"] == code
        for finding in report["findings"]:
            assert finding["grade"] != "error" or finding["advice"]
        return code, {one["check"]: one["found"] for one in report["findings"] if one["grade"] == "error"}

    return look


@contextmanager
def talking(channel: str, frame: Callable[[int], Frame]) -> Iterator[Adapter]:
    """A second adapter that sends a frame every 100 ms; `frame` makes it for the next counter."""
    adapter = Adapter(BusSettings("slcan", channel, 500_000))
    over, first = threading.Event(), threading.Event()

    def talk() -> None:
        counter = 0
        while not over.is_set():
            adapter.send(frame(counter))
            counter = (counter + 1) % 15
            first.set()
            over.wait(0.1)

    speaker = threading.Thread(target=talk)
    speaker.start()
    try:
        assert first.wait(60)
        yield adapter
    finally:
        over.set()
        speaker.join()
        adapter.close()


def test_bench_that_is_well_has_no_fault_and_without_a_yes_is_left_as_it_was(
    path: Path, doctor: Doctor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    with bench(path) as channel:
        assert doctor(channel, "--self-test") == (0, {})
        with Rig(BusSettings("slcan", channel, 500_000)) as rig:
            rig.wait_for(Node)
            for node in Node:
                state = rig.link(node).state()
                assert (state.state, state.cause, state.gate_pulses) == (State.SAFE, Fault.NONE, 0)
                assert len(rig.link(node).journal()) == 1


def test_bench_as_an_fmu_is_examined_in_its_own_time(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """So no finding depends on the load of the machine, and the heartbeat needs no priority."""
    assert main(["export", "bench", str(path), "--quiet", "--out", str(path.with_name("bench.fmu"))]) == 0
    words = ["--set", "bench.interface=inkloop_fmu", "--set", "bench.channel=bench.fmu", "--self-test", "--yes"]
    reports = []
    for _ in range(2):
        capsys.readouterr()
        assert main(["bench", "doctor", str(path), "--json", *words]) == 0
        reports.append(json.loads(capsys.readouterr().out)["findings"])
    assert reports[0] == reports[1]
    assert {one["grade"] for one in reports[0]} == {"ok"}
    found = {one["check"]: one["found"] for one in reports[0]}
    assert found["heartbeat"] == "4 nodes, a status every 100 to 100 ms"
    assert found["clock"] == "head, stage, cure, profiler: runs as fast as ours"
    assert "priority" not in found


def test_self_test_opens_the_gate_lights_the_lamp_and_leaves_everything_off(path: Path, doctor: Doctor) -> None:
    with bench(path) as channel:
        assert doctor(channel, "--self-test", "--yes") == (0, {})
        with Rig(BusSettings("slcan", channel, 500_000)) as rig:
            rig.wait_for(Node)
            head, lamp = rig.link(Node.HEAD), rig.link(Node.CURE)
            assert head.state().gate_pulses == 1
            assert lamp.times().lamp_off > lamp.times().lamp_on > 0
            assert head.times().gate_closed >= head.times().gate_opened > 0
            assert head.state().state is lamp.state().state is State.SAFE
            assert len(head.journal()) == len(lamp.journal()) == 1


def was_energised(channel: str) -> bool:
    """Whether the gate was opened or the lamp lit since power-up."""
    with Rig(BusSettings("slcan", channel, 500_000)) as rig:
        rig.wait_for((Node.HEAD, Node.CURE))
        return rig.link(Node.HEAD).state().gate_pulses > 0 or rig.link(Node.CURE).times().lamp_on > 0


def test_self_test_energises_nothing_while_an_error_stands(path: Path, doctor: Doctor) -> None:
    """An error that was only heard: the nodes answer as if they were well."""
    with bench(path, "bad-check:id=0x102,count=1000") as channel:
        code, errors = doctor(channel, "--self-test", "--yes")
        assert (code, set(errors)) == (1, {"supervision"})
        assert not was_energised(channel)


@pytest.mark.parametrize(
    ("since", "found"), [({"sessions": {77: 5}}, "another master"), ({"stopped": True}, "a stop request")]
)
def test_self_test_energises_nothing_where_a_master_or_a_stop_request_came_since(
    since: dict[str, Any], found: str, path: Path, doctor: Doctor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The checks take seconds: a run may begin in them, or a person may ask for a stop."""
    times = list[Heard]()

    def later(*arguments: Any) -> Heard:
        times.append(listen(*arguments))
        return replace(times[-1], **since) if len(times) == 2 else times[-1]

    monkeypatch.setattr("inkloop_hardware.doctor.doctor.listen", later)
    with bench(path) as channel:
        code, errors = doctor(channel, "--self-test", "--yes")
        assert (code, errors) == (1, {"self test": f"{found} is active: nothing is energised"})
        assert not was_energised(channel)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [([], "Connection refused"), (["bench.interface=pcan", "bench.channel=PCAN_USBBUS1"], "cannot be opened")],
    ids=["no listener", "no driver"],
)
def test_adapter_that_cannot_be_opened_is_reported(overrides: list[str], message: str, doctor: Doctor) -> None:
    code, errors = doctor("socket://127.0.0.1:9", *(word for override in overrides for word in ("--set", override)))
    assert (code, list(errors)) == (1, ["adapter"])
    assert message in errors["adapter"]


def test_bench_without_power_and_a_node_without_power_are_reported(path: Path, doctor: Doctor) -> None:
    with bench(path, *DEAD) as channel:
        assert set(doctor(channel)[1]) == {"bus", "nodes"}
    with bench(path, "death:node=cure") as channel:
        code, errors = doctor(channel)
        assert code == 1
        assert errors["nodes"].startswith("cure sent nothing")
        assert set(errors) == {"nodes"}, "the other three are well, and are asked"


@pytest.mark.parametrize(
    ("fault", "message"),
    [("bad-check:id=0x101,count=1000", "head"), ("stuck-counter:id=0x104,count=1000", "profiler")],
)
def test_frames_that_cannot_be_trusted_are_reported(fault: str, message: str, path: Path, doctor: Doctor) -> None:
    with bench(path, fault) as channel:
        code, errors = doctor(channel)
        assert code == 1
        assert errors["supervision"].startswith(message)
        assert errors["supervision"].endswith("cannot be trusted")


@pytest.mark.parametrize("fault", ["unplugged:nth=5", "bus-off:nth=5"])
def test_adapter_that_disappears_during_the_checks_is_reported_once(fault: str, path: Path, doctor: Doctor) -> None:
    with bench(path, fault) as channel:
        code, errors = doctor(channel)
        assert code == 1
        assert set(errors) == {"bus"}


def test_node_of_another_protocol_is_reported(path: Path, doctor: Doctor) -> None:
    newer = NodeStatus(Node.PROFILER, False, False, True, True, State.SAFE, 0, Fault.NONE, 0, 1, 0, 2)
    with bench(path, "death:node=profiler") as channel:
        with talking(channel, lambda counter: pack(CODEC, newer, counter)):
            code, errors = doctor(channel)
        assert code == 1
        assert "profiler has version 2" in errors["protocol"]


def test_another_master_is_reported_and_nothing_is_sent_while_it_prints(path: Path, doctor: Doctor) -> None:
    alive = MasterAlive(lamp_enable=False, gate_enable=False, motion_enable=False, session=77, job=5)
    with bench(path) as channel, talking(channel, lambda counter: pack(CODEC, alive, counter)) as other:
        code, errors = doctor(channel)
        ids = {message.arbitration_id for message in other.receive(0.0)}
        assert code == 1
        assert "session 77, job 5" in errors["masters"]
        assert ids, "it hears the whole bus"
        assert not [number for number in ids if number in (0x010, 0x020) or number in range(0x640, 0x648)]


def test_bench_of_another_grid_is_reported(path: Path, doctor: Doctor) -> None:
    with bench(path) as channel:
        size = [word for axis in "xy" for word in ("--set", f"grid.n{axis}=40")]
        code, errors = doctor(channel, *size, "--set", "bench.cure_ms=20000")
        assert code == 1
        assert set(errors) == {"limits"}
        assert "12 x 11 cells, the scenario 40 x 40" in errors["limits"]


def test_scenario_that_cannot_be_read_is_another_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "doctor", str(write(tmp_path, BLOCK.replace("nx = 12", "nx = -1")))]) == 2
    assert "grid.nx" in capsys.readouterr().err


def test_table_gives_a_remedy(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "doctor", str(path), "--set", "bench.channel=/dev/no-such-adapter"]) == 1
    output = " ".join(capsys.readouterr().out.split())
    assert "error" in output
    assert "plug the adapter in" in output
    assert "1 error: correct it before a print" in output


@pytest.mark.parametrize(
    ("part", "found"),
    [
        ("not-ready", "head: not ready: ink temperature or back pressure"),
        ("end-switches", "head: the gate is not confirmed closed"),
    ],
)
def test_head_that_is_not_in_order_is_not_ready_to_print(
    part: str, found: str, path: Path, doctor: Doctor, capsys: pytest.CaptureFixture[str]
) -> None:
    """By doctor, status and run alike, and the message names the bit."""
    with bench(path, f"broken:part={part}") as channel:
        code, errors = doctor(channel)
        assert code == 1
        assert errors["states"].split(": ")[1] == found.split(": ")[1]  # of the last node with this fault
        assert main(["bench", "status", str(path), "--set", f"bench.channel={channel}"]) == 0
        assert found.partition(": ")[2] in capsys.readouterr().out.splitlines()[0]
        assert main(["run", str(path), "--set", f"bench.channel={channel}", "--out", str(path.parent / "run")]) == 1
        assert f"{found}; " in capsys.readouterr().err
