"""Assessment of frames, clocks, journals, interfaces and ports by the doctor: one rule a test, no bus."""

from __future__ import annotations

import os
import re
import sys
from contextlib import ExitStack
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock, call

import can
import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor import doctor, inquiry
from inkloop_hardware.doctor.adapter_check import before_opening, configured, opened
from inkloop_hardware.doctor.doctor import try_gate_and_lamp
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.doctor.inquiry import ClockReading, Expected, NodeReport, assess, clock_rates
from inkloop_hardware.doctor.listening import Heard, judge, judge_bus, listen
from inkloop_hardware.errors import BusError, LinkTimeout, NodeRefused
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.node_state import (
    Flags,
    Happening,
    JournalRecord,
    LayerFlags,
    MapSize,
    NodeLimits,
    Roles,
    Step,
)
from inkloop_hardware.protocol.records import Fault, MasterAlive, Node, NodeStatus, Source, State, StopRequest, pack
from support.benches.node_bench import CURE, Broken, NodeBench
from support.benches.node_rig import NodeRig
from support.benches.node_status import node_state
from support.places import ROOT

CODEC = Codec()


def status(node: Node, version: int = 1) -> NodeStatus:
    return NodeStatus(node, False, False, True, True, State.SAFE, 0, Fault.NONE, 0, 1, 0, version)


def heard(*, cycle: float = 0.1, without: tuple[Node, ...] = (), version: int = 1) -> Heard:
    """A second of statuses of all nodes but some."""
    found = Heard(lasted=1.0)
    for number in range(round(1 / cycle)):
        for node in Node:
            if node not in without:
                found.take(number * cycle, pack(CODEC, status(node, version), number % 15), CODEC)
    return found


def errors(findings: list[Finding]) -> dict[str, str]:
    """The finding of each check with an error; each has an advice."""
    found = [finding for finding in findings if finding.grade is Grade.ERROR]
    assert all(finding.advice for finding in found)
    return {finding.check: finding.found for finding in found}


def heard_errors(found: Heard) -> dict[str, str]:
    return errors(list(judge(found, CODEC)))


def test_bus_without_nodes_is_told_from_another_bus_and_from_single_nodes_that_are_silent() -> None:
    silent, foreign = Heard(lasted=1.0), Heard(lasted=1.0)
    foreign.take(0.0, Frame(0x7DF, b"\1\2"), CODEC)
    assert heard_errors(heard()) == errors(list(judge_bus(foreign, foreign=True))) == {}
    assert set(heard_errors(silent)) == {"bus", "nodes"}
    assert set(errors(list(judge_bus(silent, foreign=True)))) == {"bus"}
    assert "0x7DF" in heard_errors(foreign)["bus"]
    assert heard_errors(heard(without=(Node.CURE, Node.STAGE)))["nodes"].startswith("stage and cure sent nothing")


def test_frames_of_others_are_counted_and_the_most_frequent_ids_named() -> None:
    found = heard()
    for number in range(6):
        for _ in range(number):
            found.take(0.5, Frame(number, b"\1"), CODEC)
    foreign = [one for one in judge(found, CODEC) if one.grade is Grade.WARNING]
    assert [(one.check, one.found) for one in foreign] == [
        ("bus", "15 frames outside the protocol (0x005, 0x004, 0x003, 0x002)")
    ]
    assert "55 frames in 1.0 s" in [one.found for one in judge(found, CODEC)]


def test_bus_that_is_silent_has_no_power_and_one_without_nodes_other_ids() -> None:
    silent, foreign = Heard(lasted=1.0), Heard(lasted=1.0)
    for number in (0x7DF, 1, 2, 3, 4):
        foreign.take(0.0, Frame(number, b"\1\2"), CODEC)
    assert "5 frames were received, none of the protocol (0x7DF, 0x001, 0x002, 0x003)" in heard_errors(foreign)["bus"]
    advice = [next(one.advice for one in judge(each, CODEC) if one.check == "nodes") for each in (silent, foreign)]
    assert [words.partition(",")[0] for words in advice] == ["is the bench powered", "is it powered"]


def test_cycles_of_all_regular_nodes_are_one_finding() -> None:
    found = heard(without=(Node.HEAD, Node.STAGE))
    for node, cycle in ((Node.HEAD, 0.09), (Node.STAGE, 0.11)):
        for number in range(9):
            found.take(cycle * number, pack(CODEC, status(node), number), CODEC)
    words = [one.found for one in judge(found, CODEC) if one.check == "heartbeat"]
    assert words == ["4 nodes, a status every 90 to 110 ms"]
    two = heard(without=(Node.HEAD, Node.STAGE))
    assert "2 nodes, a status every 100 to 100 ms" in [one.found for one in judge(two, CODEC)]


def test_error_frames_and_malformed_lines_point_at_the_wires() -> None:
    found = heard()
    found.errors, found.complaints = 3, {"error frames on the bus": 3, "malformed lines of the adapter": 2}
    findings = [finding for finding in judge(found, CODEC) if finding.grade is Grade.ERROR]
    assert [finding.found for finding in findings] == ["3 error frames", "2 malformed lines of the adapter"]
    assert "120 ohm" in findings[0].advice
    assert "USB" in findings[1].advice


def test_lost_frames_are_a_fault_where_they_are_many_and_the_other_nodes_are_well() -> None:
    few, many = heard(without=(Node.HEAD,)), heard(without=(Node.HEAD,))
    for number in range(1, 30):
        few.take(0.1 * number, pack(CODEC, status(Node.HEAD), (number + number // 15) % 15), CODEC)
    for number, counter in enumerate((0, 1, 3, 4, 5, 6, 8)):
        many.take(0.1 * number, pack(CODEC, status(Node.HEAD), counter), CODEC)
    found = [
        [(one.grade, one.found) for one in judge(each, CODEC) if one.check == "supervision"] for each in (few, many)
    ]
    assert found[0] == [
        (Grade.WARNING, "head: 1 statuses were lost, 29 received"),
        (Grade.OK, "check bytes and counters of 59 statuses are right"),
    ]
    assert found[1] == [(Grade.ERROR, "head: 2 statuses were lost, 7 received")]
    for number in range(20):
        many.take(0.1 * number, pack(CODEC, status(Node.HEAD), (9 + number) % 15), CODEC)
    many.monitors[Node.STAGE].lost = 1
    grades = [one.grade for one in judge(many, CODEC) if one.check == "supervision"]
    assert grades == [Grade.WARNING, Grade.WARNING, Grade.OK], "2 of 27, 1 of 10"
    many.monitors[Node.HEAD].lost = 3
    grades = [one.grade for one in judge(many, CODEC) if one.check == "supervision"]
    assert grades == [Grade.ERROR, Grade.WARNING], "3 of 27"


@pytest.mark.parametrize(
    ("seconds", "grade", "message"),
    [
        ((0.0, 0.2, 0.3, 0.4, 0.5, 0.6), Grade.OK, "one node, a status every 100 to 100 ms"),
        ([0.05 * number for number in range(20)], Grade.WARNING, "head: a status every 50 ms, the cycle is 100 ms"),
        ([0.2 * number for number in range(5)], Grade.WARNING, "head: a status every 200 ms, the cycle is 100 ms"),
        ([0.13 * number for number in range(8)], Grade.WARNING, "head: a status every 130 ms, the cycle is 100 ms"),
        ([0.12 * number for number in range(8)], Grade.OK, "one node, a status every 120 to 120 ms"),
        ([0.08 * number for number in range(8)], Grade.OK, "one node, a status every 80 to 80 ms"),
        ((0.0, 0.4, 0.8), Grade.ERROR, "head: 400 ms between two statuses, the cycle is 100 ms"),
        ((0.5,), Grade.ERROR, "head: a single status in 1.0 s"),
    ],
    ids=["one late", "too often", "too seldom", "a third too seldom", "slow", "fast", "too long a pause", "one"],
)
def test_cycle_of_a_status_is_judged_by_what_a_run_bears(seconds: Any, grade: Grade, message: str) -> None:
    found = Heard(lasted=1.0)
    for number, second in enumerate(seconds):
        found.take(second, pack(CODEC, status(Node.HEAD), number % 15), CODEC)
    assert [(one.grade, one.found) for one in judge(found, CODEC) if one.check == "heartbeat"] == [(grade, message)]


def test_missing_port_is_answered_with_those_that_have_a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [
        SimpleNamespace(device="/dev/ttyACM7", description="CANable 2.0", hwid="USB VID:PID=16D0:117E"),
        SimpleNamespace(device="/dev/ttyS0", description="ttyS0", hwid="n/a"),
        SimpleNamespace(device="/dev/ttyUSB0", description="n/a", hwid="USB VID:PID=0403:6001"),
    ]
    known = SimpleNamespace(comports=lambda: ports)
    monkeypatch.setitem(sys.modules, "serial.tools.list_ports", known)
    settings = BusSettings("slcan", "/dev/ttyACM8", 500_000)
    (found,) = (finding for finding in before_opening(settings) if finding.grade is Grade.ERROR)
    assert found.advice.endswith("machine: /dev/ttyACM7 (CANable 2.0), /dev/ttyUSB0 (n/a)")


def test_pause_is_judged_by_the_patience_of_the_settings() -> None:
    patient = heard(cycle=0.4)
    patient.silence_s = 1.0
    assert "heartbeat" not in heard_errors(patient)
    patient.take(2.4, pack(CODEC, status(Node.HEAD), 3), CODEC)
    assert "heartbeat" in heard_errors(patient)
    with ExitStack() as stack:
        adapter = Adapter(BusSettings("virtual", "silent", silence_s=1.0))
        stack.callback(adapter.close)
        adapter.now = count(0.0, 0.25).__next__
        found = listen(adapter, CODEC)
    assert found.silence_s == 1.0
    assert found.lasted >= 2.0


def test_frames_of_29_bits_are_none_of_the_protocol() -> None:
    frame = pack(CODEC, status(Node.HEAD), 0)
    kinds = [{"is_extended_id": True}, {"is_remote_frame": True}, {"is_fd": True}, {"is_error_frame": True}, {}]
    names = ("is_extended_id", "is_remote_frame", "is_fd", "is_error_frame")
    heard_frames = [
        SimpleNamespace(arbitration_id=frame.arbitration_id, data=frame.data, **(dict.fromkeys(names, False) | kind))
        for kind in kinds
    ]
    adapter: Any = SimpleNamespace(
        settings=BusSettings("virtual", "mixed"),
        receive=lambda wait_s: heard_frames,
        complaints=dict[str, int],
        now=count(0.0, 0.5).__next__,
    )
    found = listen(adapter, CODEC, seconds=0.6)
    assert (found.frames, found.errors, len(found.times[Node.HEAD])) == (1, 1, 1)


def test_wrong_check_byte_repeated_counter_and_jump_are_counted() -> None:
    found = heard(without=(Node.HEAD, Node.STAGE, Node.CURE))
    for number in (0, 1, 1, 1, 9):
        found.take(0.1 * number, pack(CODEC, status(Node.HEAD), number), CODEC)
    frame = pack(CODEC, status(Node.STAGE), 3)
    for number in range(5):
        found.take(0.1 * number, Frame(frame.arbitration_id, bytes([frame.data[0] ^ 1]) + frame.data[1:]), CODEC)
    findings = [finding.found for finding in judge(found, CODEC) if finding.check == "supervision"]
    assert findings[0].startswith("head: of its statuses 2 repeated, 1 jumped")
    assert findings[1] == "stage: of its statuses 5 damaged; it cannot be trusted"
    assert heard_errors(found)["nodes"].startswith("cure sent nothing"), "a damaged status is not silence"


def test_other_version_of_the_protocol_is_named_for_each_node() -> None:
    assert heard_errors(heard(version=2))["protocol"].endswith("has version 2 of the protocol, this inkloop 1")


def test_unknown_state_of_a_node_is_reported() -> None:
    found, frame = heard(), bytearray(pack(CODEC, status(Node.HEAD), 10).data)
    found.take(1.0, Frame(0x101, bytes(frame[:7])), CODEC)
    assert "has 7 bytes, expected 8" in heard_errors(found)["protocol"]


@pytest.mark.parametrize(("sessions", "message"), [((5,), "session 5, job 9"), ((5, 6), "2 masters, sessions 5, 6")])
def test_masters_on_the_bus_are_named(sessions: tuple[int, ...], message: str) -> None:
    found = heard()
    for session in sessions:
        found.take(0.5, pack(CODEC, MasterAlive(False, False, False, session, 9), 1), CODEC)
    assert message in heard_errors(found)["masters"]


def test_stop_request_is_reported() -> None:
    found = heard()
    found.take(0.5, pack(CODEC, StopRequest(True, Source.OPERATOR), 1), CODEC)
    assert "stop request" in heard_errors(found)["masters"]
    found.take(0.6, pack(CODEC, StopRequest(False, Source.OPERATOR), 2), CODEC)
    assert heard_errors(found) == {}


def report(node: Node = Node.HEAD) -> NodeReport:
    """A node that is well."""
    roles = Roles[node.upper()]
    state = node_state(state=State.SAFE, roles=roles)
    limits = NodeLimits(1000, 0.3, 10.0, 0.5, 120.0, 30.0, 60.0, 4095)
    record = JournalRecord(7, Happening.BOOT, Step.NONE, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, LayerFlags(0), 0.0, 0, 0)
    shape = (20, 20) if node is Node.PROFILER else None
    clock = (ClockReading(5.0, 100.0, 100.01), ClockReading(6.0, 101.0, 101.01))
    return NodeReport(node, "inkloop 0.1.0", state, limits, (record, replace(record, number=6)), shape, clock)


def of_state(**changes: Any) -> NodeReport:
    return replace(report(), state=replace(report().state, **changes))


def of_limits(**changes: Any) -> NodeReport:
    return replace(report(), limits=replace(report().limits, **changes))


def of_clock(seconds: float) -> NodeReport:
    """A head whose clock shows 5 s and then this, while one second passes."""
    return replace(report(), clock=(report().clock[0], ClockReading(seconds, 101.0, 101.01)))


def expected(nx: int = 20, ny: int = 20, cure_ms: int = 100) -> Expected:
    return Expected(Job(nx, ny, 1e-4, np.zeros((nx, ny)), np.ones((nx, ny), np.bool_)), cure_ms)


@pytest.mark.parametrize(
    "nodes",
    [
        [report(node) for node in Node],
        [replace(one, state=replace(one.state, roles=Roles.HEAD | Roles.STAGE)) for one in map(report, list(Node)[:2])],
        [of_limits(block=16, alive=0.2, pattern_bytes=50)],
        [replace(report(Node.PROFILER), map_shape=(0, 0))],
    ],
    ids=["four nodes", "head and stage in one", "just enough", "nothing scanned yet"],
)
def test_node_that_is_well_has_no_fault(nodes: list[NodeReport]) -> None:
    assert errors(list(assess(nodes, expected()))) == {}


@pytest.mark.parametrize(
    ("one", "check", "message"),
    [
        (of_clock(6.1), "clock", "10% too fast"),
        (of_clock(5.9), "clock", "10% too slow"),
        (of_clock(0.2), "clock", "restarted"),
        (of_state(state=State.FAULT, cause=Fault.LAMP_TIME), "states", "head: FAULT because of LAMP_TIME"),
        (of_limits(block=15), "limits", "it takes blocks of 15 bytes"),
        (of_limits(alive=0.199), "limits", "waits 199 ms for MasterAlive"),
        (of_state(flags=Flags.JOURNAL_DAMAGED), "states", "journal"),
        (of_state(flags=Flags.JOURNAL_UNREADABLE), "states", "could not be read"),
        (of_state(flags=Flags.STOPPED), "states", "stop request"),
        (of_state(roles=Roles.STAGE), "states", "roles"),
        (of_limits(pattern_bytes=49), "limits", "50 bytes, it has room for 49"),
        (replace(report(Node.PROFILER), map_shape=(30, 20)), "limits", "30 x 20 cells, the scenario 20 x 20"),
        (replace(report(Node.CURE), limits=replace(report().limits, lamp=0.1)), "limits", "itself off after 100 ms"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_report_of_a_node_is_checked_against_the_scenario(one: NodeReport, check: str, message: str) -> None:
    assert message in errors(list(assess([one], expected())))[check]


@pytest.mark.parametrize(
    ("one", "check", "message"),
    [
        (of_state(flags=Flags.DRY_RUN), "states", "head: in a dry run"),
        (replace(report(), journal=()), "journals", "head: its journal is empty"),
        (
            replace(report(), journal=(report().journal[0], replace(report().journal[1], number=5))),
            "journals",
            "head: a record between 5 and 7 cannot be read",
        ),
    ],
    ids=["dry run", "no journal", "one record missing"],
)
def test_what_a_person_should_know_is_a_warning(one: NodeReport, check: str, message: str) -> None:
    (found,) = (finding for finding in assess([one], expected()) if finding.grade is Grade.WARNING)
    assert (found.check, found.found) == (check, message)


@pytest.mark.parametrize(("seconds", "is_right"), [(5.965, False), (5.97, True), (6.03, True), (6.035, False)])
def test_clock_may_be_off_by_two_percent_beside_the_time_of_the_answers(seconds: float, is_right: bool) -> None:
    assert ("clock" not in errors(list(assess([of_clock(seconds)], expected())))) is is_right


def test_grid_of_a_scenario_is_compared_side_by_side_and_with_its_materials() -> None:
    profiler = replace(report(Node.PROFILER), map_shape=(30, 20))
    assert errors(list(assess([profiler], expected(30, 20)))) == {}
    found = errors(list(assess([profiler], expected(20, 30))))
    assert found == {"limits": "profiler: its maps have 30 x 20 cells, the scenario 20 x 30"}
    two = expected()
    two = replace(two, job=replace(two.job, inks=(Ink(), Ink())))
    found = errors(list(assess([of_limits(pattern_bytes=99)], two)))
    assert found == {"limits": "head: a pattern of 20 x 20 cells takes 100 bytes, it has room for 99"}


def test_what_is_well_is_said_of_all_nodes_at_once() -> None:
    stopped = of_state(cause=Fault.STOP_REQUEST)
    found = list(assess([stopped, report(Node.STAGE), report(Node.CURE)], None))
    assert [(one.check, one.found) for one in found] == [
        ("services", "head, stage, cure: inkloop 0.1.0"),
        ("states", "head: SAFE because of STOP_REQUEST"),
        ("states", "stage, cure: SAFE"),
        ("clock", "head, stage, cure: runs as fast as ours"),
        ("journals", "head, stage, cure: its newest 2 of 7 records can be read"),
        ("limits", "no scenario was given to compare them with"),
    ]
    assert [one.grade for one in found] == [*5 * [Grade.OK], Grade.SKIPPED]


def test_slow_answers_do_not_make_a_clock_wrong() -> None:
    rates = clock_rates(ClockReading(5.0, 100.0, 100.4), ClockReading(6.0, 101.0, 101.4))
    assert rates == pytest.approx((0.999 / 1.4, 1.001 / 0.6), rel=1e-12, abs=0.0)
    slow = replace(report(), clock=(ClockReading(5.0, 100.0, 100.4), ClockReading(6.0, 101.0, 101.4)))
    assert errors(list(assess([slow], expected()))) == {}


@pytest.mark.parametrize(
    ("settings", "check", "message"),
    [
        (BusSettings("slcam", "x"), "interface", "no interface 'slcam'"),
        (BusSettings(None, None), "interface", "no interface is named"),
        (BusSettings("slcan", None), "adapter", "no channel is named"),
        (BusSettings("slcan", "/dev/no-such-adapter"), "adapter", "there is no /dev/no-such-adapter"),
        (BusSettings("robotell", "/dev/no-such-adapter"), "adapter", "there is no /dev/no-such-adapter"),
        (BusSettings("socketcan", "can7"), "adapter", "no network interface 'can7'"),
        (BusSettings("socketcan", "can0"), "adapter", "can0 is down"),
        (BusSettings("socketcan", "can1"), "adapter", "can1 has no carrier: its controller is bus-off"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_missing_adapter_is_reported_before_it_is_opened(
    settings: BusSettings, check: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("can0", "can1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "operstate").write_text("down\n")
    (tmp_path / "can1" / "carrier").write_text("0\n")  # reading that of can0 fails, as with an interface that is down
    assert message in errors(list(before_opening(configured(settings), tmp_path)))[check]


@pytest.mark.parametrize(
    ("settings", "warnings"),
    [
        (BusSettings("slcan", "socket://127.0.0.1:28550"), []),
        (BusSettings("slcan", "COM3", 500_000), []),
        (BusSettings("slcan", "COM3"), ["no bit rate is set, the adapter keeps its own"]),
        (BusSettings("virtual", 0), []),
    ],
    ids=str,
)
def test_channel_that_is_no_file_is_not_looked_for(settings: BusSettings, warnings: list[str]) -> None:
    """The emulator has no bit rate; a channel may be a number."""
    found = list(before_opening(settings))
    assert errors(found) == {}
    assert [finding.found for finding in found if finding.grade is Grade.WARNING] == warnings


@pytest.mark.parametrize("missing", [os.R_OK, os.W_OK])
def test_port_that_this_user_may_not_use_is_reported_with_its_group(
    missing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = tmp_path / "ttyACM0"
    port.touch()
    monkeypatch.setattr("inkloop_hardware.doctor.adapter_check.os.access", lambda path, mode: not mode & missing)
    (found,) = (one for one in before_opening(BusSettings("slcan", str(port), 500_000)) if one.grade is Grade.ERROR)
    assert found.found == f"{port} may not be read and written by this user"
    assert f"sudo usermod -a -G {port.group()} $USER" in found.advice


def test_emulator_that_does_not_run_is_the_first_guess_at_a_local_port() -> None:
    adapter, finding = opened(BusSettings("slcan", "socket://127.0.0.1:1", 500_000))
    assert adapter is None
    assert "does `inkloop bench emulate` run?" in finding.advice


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (OSError("pcanbasic library not found."), "driver"),
        (OSError(97, "Address family not supported by protocol"), "driver"),
        (NameError("name 'canGetNumberOfChannels' is not defined"), "driver"),
        (NotImplementedError("Cannot import module can.interfaces.gs_usb"), "driver"),
        (ImportError("Please install python-ics"), "driver"),
        (PermissionError(13, "Permission denied"), "access to it"),
        (OSError("[Errno 13] could not open port: Permission denied"), "access to it"),
        (OSError(1, "Operation not permitted"), "access to it"),
        (OSError(13, "refused"), "access to it"),
        (OSError(16, "Device or resource busy"), "another program"),
        (OSError(16, "in use"), "another program"),
        (OSError(11, "Resource temporarily unavailable"), "another program"),
        (OSError("could not exclusively lock port"), "another program"),
        (OSError("the port is busy"), "another program"),
        (OSError(19, "No such device"), "plugged in"),
    ],
)
def test_adapter_that_cannot_be_opened_is_reported_with_its_cause(
    error: Exception, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its back-end raises."""
    monkeypatch.setattr("inkloop_hardware.bus.adapter._open", Mock(side_effect=error))
    adapter, finding = opened(BusSettings("pcan", "PCAN_USBBUS1"))
    assert adapter is None
    assert str(error) in finding.found
    assert advice in finding.advice


def test_adapter_is_that_of_python_can_s_own_configuration_where_a_scenario_names_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = {"interface": "slcan", "channel": 3, "bitrate": 250_000}
    monkeypatch.setattr("inkloop_hardware.doctor.adapter_check.load_config", lambda config: own | config)
    assert configured(BusSettings(silence_s=1.0)) == BusSettings("slcan", "3", 250_000, silence_s=1.0)
    assert configured(BusSettings("pcan", "a")) == BusSettings("pcan", "a", 250_000)


@pytest.mark.parametrize(
    ("settings", "advice"),
    [
        (BusSettings("slcan"), 'set bench.channel, "/dev/ttyACM0"'),
        (BusSettings("socketcan"), 'set bench.channel, "can0"'),
        (BusSettings("kvaser"), "set bench.channel, see its page"),
        (BusSettings("socketcan", "can7"), "plug the adapter in; it has slcan0, vcan0"),
        (BusSettings("slcam", "a"), "did you mean 'slcan'?"),
    ],
    ids=str,
)
def test_advice_names_what_would_do(settings: BusSettings, advice: str, tmp_path: Path) -> None:
    for name in ("vcan0", "slcan0", "eth0"):
        (tmp_path / name).mkdir()
    (found,) = (one for one in before_opening(settings, tmp_path) if one.grade is Grade.ERROR)
    assert found.advice == advice


def test_page_names_every_check() -> None:
    page = (ROOT / "docs/how-to/when-the-bench-does-not-answer.md").read_text()
    sources = [path.read_text() for path in (ROOT / "hardware/inkloop_hardware/doctor").glob("*.py")]
    checks = set(re.findall(r"\bFinding\.(?:error|ok|warning|skipped)\(\s*\"([a-z ]+)\"", "".join(sources)))
    assert {"interface", "clock", "self test", "frames"} <= checks
    assert not sorted(check for check in checks if f"\n    {check} " not in page and f"**{check}**" not in page)


def test_report_of_a_profiler_has_the_map_that_it_sends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inquiry, "_read_clock", lambda link: SimpleNamespace(answered=0.0))
    link = Mock(node=Node.PROFILER, map_size=lambda: MapSize(1, 30, 20), now=lambda: 0.0)
    assert inquiry.read_node(link).map_shape == (30, 20)


@pytest.mark.compiled
def test_self_test_tries_gate_then_lamp_with_the_enables_of_each() -> None:
    with NodeBench() as bench:
        rig = NodeRig(bench)
        findings = list(try_gate_and_lamp(rig))
        assert [finding.grade for finding in findings] == [Grade.OK, Grade.OK]
        assert rig.enables == [2, 1]
        gate, lamp = bench.times(), bench.times(CURE)
        assert gate.gate_closed > gate.gate_opened
        assert 100 <= lamp.lamp_off - lamp.lamp_on <= 105
        assert [finding.found for finding in findings] == [
            f"gate: seen open and closed again, driven for {gate.gate_closed - gate.gate_opened} ms",
            f"lamp: seen lit for {lamp.lamp_off - lamp.lamp_on} ms and dark again, the gate closed",
        ]
        assert [bench.gate_openings, bench.lamp_pulses, bench.lamp_with_gate] == [1, 1, 0]


@pytest.mark.compiled
@pytest.mark.parametrize(("broken", "tests"), [(Broken.GATE_STAYS_CLOSED, 1), (Broken.LAMP_STAYS_ON, 1)])
def test_gate_that_is_not_confirmed_gets_no_light(broken: int, tests: int) -> None:
    with NodeBench() as bench:
        bench.broken(broken)
        findings = list(try_gate_and_lamp(NodeRig(bench)))
        assert len(findings) == tests
        assert findings[-1].grade is Grade.ERROR
        assert "everything is off" in findings[-1].advice
        assert bench.lamp_pulses == 0


@pytest.mark.compiled
def test_nodes_that_need_a_person_are_not_energised() -> None:
    with NodeBench() as bench:
        bench.stop(True)
        bench.stop(False)
        findings = list(try_gate_and_lamp(NodeRig(bench)))
        assert [finding.grade for finding in findings] == [Grade.SKIPPED]
        assert [bench.gate_openings, bench.lamp_pulses, bench.lamp_with_gate] == [0, 0, 0]


@pytest.mark.parametrize(("code", "grade"), [(0x31, Grade.SKIPPED), (0x22, Grade.ERROR)])
def test_firmware_without_a_self_test_is_no_fault(code: int, grade: Grade) -> None:
    head = Mock(node=Node.HEAD)
    found = doctor._failed(head, NodeRefused("head: refuses", code))
    assert found.grade is grade
    assert ("the firmware of the head has no self test" in found.found) is (code == 0x31)


def test_only_nodes_of_this_protocol_are_asked() -> None:
    found = heard(without=(Node.CURE,))
    found.take(1.0, pack(CODEC, status(Node.STAGE, version=2), 10), CODEC)
    assert doctor._understood(found, CODEC) == [Node.HEAD, Node.PROFILER]


class Answering:
    """An adapter by an injected clock: frames of several ids that come at once, then one of the node later."""

    def __init__(self) -> None:
        self.seconds, self.waits = 10.0, list[float]()
        answers = (0x641, 0x101, 0x643, 0x641)
        self.coming = [[can.Message(arbitration_id=one, data=[k]) for k, one in enumerate(answers)], []]

    def now(self) -> float:
        return self.seconds

    def receive(self, wait_s: float) -> list[can.Message]:
        self.waits.append(wait_s)
        self.seconds += 0.3
        return self.coming.pop(0) if self.coming else [can.Message(arbitration_id=0x641, data=[9])]


def test_answers_of_one_node_are_taken_in_their_order_and_waited_for_no_longer_than_asked() -> None:
    adapter: Any = Answering()
    wire = inquiry.OwnWire(adapter, 0x641)
    assert [wire.receive(0.5) for _ in range(2)] == [b"\0", b"\3"]
    assert wire.receive(0.2) is None
    assert wire.receive(0.5) == b"\x09"
    assert adapter.waits == pytest.approx([0.5, 0.2, 0.5], rel=1e-9, abs=0.0)


def test_second_reading_of_a_clock_comes_a_quarter_of_a_second_after_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = iter((ClockReading(5.0, 100.0, 100.01), ClockReading(5.3, 100.3, 100.31)))
    monkeypatch.setattr(inquiry, "_read_clock", lambda link: next(readings))
    link = Mock(node=Node.STAGE, now=lambda: 100.11)
    found = inquiry.read_node(link, status(Node.STAGE))
    assert link.pause.mock_calls == [call(pytest.approx(0.15, rel=1e-9, abs=0.0))]
    assert (found.map_shape, found.status) == (None, status(Node.STAGE))
    assert [reading.node for reading in found.clock] == [5.0, 5.3]


def test_bus_is_listened_to_for_twelve_statuses_and_what_is_well_is_no_complaint() -> None:
    adapter: Any = SimpleNamespace(
        settings=BusSettings("virtual", "quiet"),
        receive=lambda wait_s: [],
        complaints=lambda: {"frames sent again": 0, "malformed lines of the adapter": 2},
        now=count(0.0, 0.0625).__next__,
    )
    found = listen(adapter, CODEC)
    assert 1.2 <= found.lasted < 1.5
    assert found.complaints == {"malformed lines of the adapter": 2}


@pytest.mark.parametrize("flag", [Flags.JOURNAL_DAMAGED, Flags.JOURNAL_UNREADABLE])
def test_journal_that_cannot_be_used_is_reported_once(flag: Flags) -> None:
    one = replace(of_state(flags=flag), journal=())
    assert [finding.check for finding in assess([one], None)] == ["services", "states", "clock", "limits"]


def test_nodes_are_judged_by_answers_and_statuses_and_one_that_does_not_answer_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An adapter that is gone ends the examination."""
    failures: dict[Node, Exception] = {Node.CURE: LinkTimeout("no answer of cure")}

    def read_node(link: Any, status: NodeStatus | None) -> NodeReport:
        if link.node in failures:
            raise failures[link.node]
        return replace(report(link.node), status=status)

    monkeypatch.setattr(inquiry, "read_node", read_node)
    links: Any = [SimpleNamespace(node=node) for node in (Node.HEAD, Node.STAGE, Node.CURE)]
    statuses = {Node.HEAD: replace(status(Node.HEAD), ready=False)}
    found = errors(list(inquiry.ask(links, None, statuses)))
    assert found == {"services": "no answer of cure", "states": "head: not ready: ink temperature or back pressure"}
    assert errors(list(inquiry.ask(links[:2], None))) == {}
    failures[Node.STAGE] = BusError("the adapter is gone")
    with pytest.raises(BusError, match="is gone"):
        list(inquiry.ask(links, None))


@pytest.mark.parametrize(
    ("wanted", "found", "heard_again", "expected"),
    [
        (
            False,
            [],
            {},
            (Grade.SKIPPED, "gate and lamp were not tried (the gate opens and closes, then the lamp lights"),
        ),
        (False, [Finding.error("bus", "a", "b")], {}, (Grade.SKIPPED, "gate and lamp were not tried")),
        (True, [Finding.error("bus", "a", "b")], {}, (Grade.SKIPPED, "there are errors: nothing is energised")),
        (True, [], {"sessions": {5: 9}}, (Grade.ERROR, "another master is active: nothing is energised")),
        (True, [], {"stopped": True}, (Grade.ERROR, "a stop request is active: nothing is energised")),
        (True, [], {}, None),
    ],
)
def test_gate_and_lamp_are_tried_only_if_that_is_wanted_and_nothing_speaks_against_it(
    wanted: bool,
    found: list[Finding],
    heard_again: dict[str, Any],
    expected: tuple[Grade, str] | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(doctor, "listen", lambda adapter, codec, seconds: Heard(lasted=seconds, **heard_again))
    reason = doctor._why_not(wanted, found, Mock(), CODEC)
    if expected is None:
        assert reason is None
    else:
        assert reason is not None
        assert (reason.grade, reason.found.startswith(expected[1])) == (expected[0], True)
