"""Reports of nodes to a person, and requests by the commands of a person; the rig is a double."""

from __future__ import annotations

import math
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices import commands
from inkloop_hardware.devices.readiness import NotReady, blocked, make_ready, missing
from inkloop_hardware.doctor import status as bench_status
from inkloop_hardware.doctor.listening import Heard
from inkloop_hardware.doctor.status import NodeReport, status
from inkloop_hardware.errors import AnotherMaster
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Flags, LayerFlags, NodeLimits, NodeState, Roles
from inkloop_hardware.protocol.records import Fault, Node, State, pack
from inkloop_hardware.protocol.services import ClearOption, Key, Outcome, Routine
from support.benches.node_status import IDLE_HEAD, node_state


def state(**changes: Any) -> NodeState:
    return node_state(**{"job": 4, "layer": 3, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, None),
        ({"flags": Flags.DRY_RUN | Flags.BY_WATCHDOG, "cause": Fault.STOP_REQUEST}, None),
        (
            {"flags": Flags.STOPPED | Flags.NEEDS_OPERATOR},
            "a stop request is active; release it, check the bench, then",
        ),
        (
            {"flags": Flags.JOURNAL_DAMAGED | Flags.NEEDS_OPERATOR},
            "its journal cannot be written; replace its storage, nothing is energised until then",
        ),
        (
            {"flags": Flags.JOURNAL_UNREADABLE | Flags.NEEDS_OPERATOR, "cause": Fault.JOURNAL_UNREADABLE},
            "its journal could not be read at power-up, so what it has done is not known; switch it off and on; ",
        ),
        (
            {"flags": Flags.NEEDS_OPERATOR, "unknown": 0b1010, "layer_flags": LayerFlags.CURE_UNKNOWN},
            "pass 2, 4 of layer 3, which was begun and whose progress is unknown; check the bench, then",
        ),
        (
            {"flags": Flags.NEEDS_OPERATOR, "layer_flags": LayerFlags.CURE_UNKNOWN, "cause": Fault.STOP_REQUEST},
            "a cure of layer 3, which was begun and whose duration is unknown; it will be repeated; check the bench",
        ),
        (
            {"flags": Flags.NEEDS_OPERATOR, "layer_flags": LayerFlags.CURE_UNKNOWN, "cause": Fault.LAMP_TIME},
            "in which the lamp took no current until its end; it will be repeated; check lamp, driver and supply, then",
        ),
        (
            {"flags": Flags.NEEDS_OPERATOR, "cause": Fault.STORAGE_FAILED},
            "needs a person because of STORAGE_FAILED; make room in its storage, then `inkloop bench clear SCENARIO`",
        ),
        ({"flags": Flags.NEEDS_OPERATOR}, "needs a person because of a step that it gave up; check the bench, then"),
    ],
)
def test_node_that_needs_a_person_says_why_and_what_to_do(changes: dict[str, Any], message: str | None) -> None:
    found = blocked(Node.HEAD, state(**changes))
    assert found is None if message is None else found and found.startswith("head: ") and message in found


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, "head     IDLE; v1"),
        ({"cause": Fault.STOP_REQUEST}, "head     IDLE; v1"),
        ({"state": State.SAFE, "cause": Fault.STOP_REQUEST}, "head     SAFE because of STOP_REQUEST; v1"),
        ({"state": State.FAULT, "cause": Fault.NONE}, "head     FAULT; v1"),
        ({"state": State.FAULT, "cause": Fault.LAMP_TIME}, "head     FAULT because of LAMP_TIME; v1"),
        (
            {"passes": 4, "done": 0b0101, "unknown": 0b1000},
            "head     IDLE, layer 3 of job 4: 2 of 4 passes done, 1 unknown; v1",
        ),
        (
            {"flags": Flags.NEEDS_OPERATOR | Flags.STOPPED | Flags.DRY_RUN},
            "head     IDLE, needs a person to clear it, a stop request is active, in a dry run; v1",
        ),
        (
            {"flags": Flags.JOURNAL_DAMAGED | Flags.BY_WATCHDOG | Flags.MAP_READY},
            "head     IDLE, its journal is damaged, reset by its watchdog; v1",
        ),
        (
            {"state": State.SAFE, "cause": Fault.JOURNAL_UNREADABLE, "flags": Flags.JOURNAL_UNREADABLE},
            "head     SAFE because of JOURNAL_UNREADABLE, its journal could not be read at power-up; v1",
        ),
    ],
)
def test_report_of_a_node_is_one_line(changes: dict[str, Any], line: str) -> None:
    rig: Any = Rig(Node.HEAD, **changes)
    (found,) = (each for each in status(rig) if each.node == "head")
    assert str(found) == line
    assert isinstance(found, NodeReport)
    layer = (4, 3) if changes.get("passes") else (0, 0)
    assert (found.job, found.layer) == layer
    assert (rig.log[0], rig.log[-1]) == ("attached", "detached")


def test_report_names_what_the_node_lacks_by_its_status() -> None:
    rig: Any = Rig(Node.HEAD, flags=Flags.DRY_RUN)
    right = rig.status(Node.HEAD)
    right.ready = right.gate_closed = right.gate_open = False
    rig.status = lambda node: right
    lines = [str(found) for found in status(rig)]
    assert lines[0] == (
        "head     IDLE, in a dry run, not ready: ink temperature or back pressure, the gate is not confirmed closed; v1"
    )
    assert lines[1] == "stage    IDLE; v1"


def test_print_of_another_program_is_only_listened_to(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = Heard(lasted=1.5)
    for number in range(3):
        heard.take(0.1 * number, pack(Codec(), IDLE_HEAD, number), Codec())
    heard.monitors[Node.STAGE].damaged = 2
    adapter = Mock()
    monkeypatch.setattr(bench_status, "Adapter", lambda settings: adapter)
    monkeypatch.setattr(bench_status, "listen", lambda adapter, codec: heard)

    def lines() -> list[Any]:
        refusing = Mock(side_effect=AnotherMaster("another one"))
        rig: Any = SimpleNamespace(attach=refusing, settings=BusSettings("virtual", "heard"))
        return list(status(rig))

    nodes = ["head: idle, 3 statuses", "stage: 2 damaged statuses", "cure: no status", "profiler: no status"]
    assert lines() == ["a print has the channel: nothing was sent, this was heard in 1.5 s", *nodes]
    heard.sessions, heard.stopped = {5: 9, 6: 10}, True
    assert lines() == [
        "session 5 prints job 9, session 6 prints job 10: nothing was sent, this was heard in 1.5 s",
        "a stop request is active",
        *nodes,
    ]
    assert adapter.close.call_count == 2


class Rig(SimpleNamespace):
    """Nodes in a state, `node` in another one; `log` has what was asked of them."""

    def __init__(self, node: Node = Node.HEAD, *, version: int | None = None, **changes: Any) -> None:
        super().__init__(job=9, log=[], lost=())
        self.states = {each: state(**(changes if each == node else {})) for each in Node}
        self.version = Codec().protocol_version if version is None else version
        self.changed = node

    def attach(self) -> None:
        self.log.append("attached")

    def detach(self) -> None:
        self.log.append("detached")

    def wait_for(self, nodes: Any) -> None:
        self.log.append(("wait", tuple(nodes)))

    def check_alone(self) -> None:
        self.log.append("alone")

    def status(self, node: Node) -> Any:
        right = Codec().protocol_version
        return SimpleNamespace(
            protocol_version=self.version if node == self.changed else right, ready=True, gate_closed=True
        )

    @contextmanager
    def enabled(self, **enables: bool) -> Any:
        self.log.append(("on", enables))
        yield
        self.log.append("off")

    def link(self, node: Node) -> Any:
        def routine(which: Routine, key: Key, option: bytes = b"", *, limit_s: float) -> Outcome:
            self.log.append((node.lower(), which.name, bytes(key), option, limit_s))
            return Outcome.DONE

        motion = {Node.HEAD: 11.0, Node.STAGE: 30.0}.get(node, 1.0)
        limits = NodeLimits(100, 1.0, 2.0, 3.0, 4.0, motion, 6.0, 7)
        return SimpleNamespace(
            routine=routine, state=lambda: self.states[node], version=lambda: "v1", limits=lambda: limits
        )


def key(node: str, what: str, option: bytes = b"", limit_s: float = 5.0) -> tuple[Any, ...]:
    return (node, what, bytes(Key(9, 0)), option, limit_s)


NAMES = [node.lower() for node in Node]


@pytest.mark.parametrize("give_up", [False, True])
def test_clear_releases_every_node_as_a_person(give_up: bool) -> None:
    rig: Any = Rig()
    shown = list(commands.clear_all(rig, give_up=give_up))
    option = bytes([int(ClearOption.OPERATOR) + give_up * int(ClearOption.ABANDON)])
    assert rig.log == [("wait", tuple(Node)), *(key(name, "CLEAR", option) for name in NAMES)]
    assert shown == [f"{name}: cleared" + (", its open layer is given up" if give_up else "") for name in NAMES]


def test_journal_that_could_not_be_read_is_not_cleared_unless_it_is_given_up() -> None:
    rig: Any = Rig(Node.STAGE, flags=Flags.JOURNAL_UNREADABLE | Flags.NEEDS_OPERATOR)
    with pytest.raises(NotReady, match=r"^stage: its journal could not be read .* --give-up`"):
        list(commands.clear_all(rig))
    assert [entry[0] for entry in rig.log] == ["wait", "head"]
    assert len(list(commands.clear_all(rig, give_up=True))) == len(NAMES)


@pytest.mark.parametrize(
    ("command", "line", "log"),
    [
        (
            "home",
            "stage: at its zero",
            lambda: [
                ("wait", (Node.STAGE,)), key("stage", "CLEAR", b"\0"), ("on", {"motion": True}),
                key("stage", "HOME", b"", 32.0), "off",
            ],
        ),
        (
            "purge",
            "head: purged",
            lambda: [("wait", (Node.HEAD,)), key("head", "CLEAR", b"\0"), key("head", "PURGE", b"", 13.0)],
        ),
    ],
)  # fmt: skip
def test_node_is_cleared_before_it_acts_within_its_own_limit(command: str, line: str, log: Any) -> None:
    rig: Any = Rig()
    assert list(getattr(commands, command)(rig)) == [line]
    assert rig.log == log()


def test_nodes_are_made_ready_and_homed_where_the_stage_is_one_of_them() -> None:
    rig: Any = Rig(Node.CURE, flags=Flags.DRY_RUN)
    limits = make_ready(rig, [Node.STAGE, Node.CURE])
    assert rig.log == [
        ("wait", (Node.STAGE, Node.CURE)), "alone", key("stage", "CLEAR", b"\0"), key("cure", "CLEAR", b"\0"),
        key("cure", "DRY_RUN", b"\0"), ("on", {"motion": True}), key("stage", "HOME", b"", 32.0), "off",
    ]  # fmt: skip
    assert {node: limit.motion for node, limit in limits.items()} == {Node.STAGE: 30.0, Node.CURE: 1.0}
    without: Any = Rig()
    make_ready(without, [Node.PROFILER])
    assert without.log[2:] == [key("profiler", "CLEAR", b"\0")]


def test_other_protocol_and_other_roles_are_named_before_anything_is_asked() -> None:
    right = Codec().protocol_version
    old: Any = Rig(Node.CURE, version=99)
    with pytest.raises(NotReady) as refused:
        make_ready(old, list(Node))
    assert str(refused.value) == (
        f"cure: has version 99 of the protocol (v1), this inkloop {right}; update the older of the two"
    )
    new: Any = Rig(Node.CURE, version=0)
    with pytest.raises(NotReady, match=r"^cure: has version 0 of the protocol"):
        make_ready(new, list(Node))
    other: Any = Rig(Node.PROFILER, roles=Roles.HEAD | Roles.STAGE, flags=Flags.STOPPED)
    with pytest.raises(NotReady, match=r"^profiler: the node at its ids has the roles .*; give it its own ids$"):
        make_ready(other, list(Node))
    for rig in (old, other):
        assert rig.log == [("wait", tuple(Node)), "alone"]
    make_ready(Rig(Node.STAGE, roles=Roles.STAGE), [Node.STAGE])  # type: ignore[arg-type]


def test_all_nodes_that_need_a_person_are_named_at_once() -> None:
    rig: Any = Rig()
    rig.states = {node: state(flags=Flags.STOPPED) for node in Node}
    with pytest.raises(NotReady) as refused:
        make_ready(rig, list(Node))
    assert [line.split(":")[0] for line in str(refused.value).split("\n")] == NAMES


CLOSED = {"ready": True, "gate_closed": True, "gate_open": False}


@pytest.mark.parametrize(
    ("node", "status", "found"),
    [
        *((node, CLOSED, []) for node in Node),
        (Node.HEAD, CLOSED | {"ready": False}, ["not ready: ink temperature or back pressure; wait for them, or"]),
        (Node.STAGE, CLOSED | {"ready": False}, []),  # a run homes it
        (Node.CURE, CLOSED | {"ready": False}, ["not ready: lamp or gate; check both"]),
        (Node.PROFILER, CLOSED | {"ready": False}, ["not ready: its sensor; check its supply"]),
        *((node, CLOSED | {"gate_closed": False, "gate_open": True}, []) for node in Node),
        (Node.HEAD, CLOSED | {"gate_closed": False}, ["the gate is not confirmed closed; check"]),
        (Node.CURE, CLOSED | {"gate_closed": False}, ["the gate is not confirmed closed; check"]),
        (Node.STAGE, CLOSED | {"gate_closed": False}, []),
        (Node.PROFILER, CLOSED | {"gate_closed": False}, []),
    ],
)
def test_what_a_node_lacks_is_named_for_those_that_need_it(
    node: Node, status: dict[str, bool], found: list[str]
) -> None:
    lacks = missing(node, SimpleNamespace(**status))  # type: ignore[arg-type]
    assert len(lacks) == len(found)
    assert all(one.startswith(words) for one, words in zip(lacks, found, strict=True))
    assert missing(node, None) == []


class ClosingGate(Rig):
    """Nodes whose gate is confirmed closed after so many looks."""

    def __init__(self, looks: float) -> None:
        super().__init__()
        self.looks = looks

    def pause(self, seconds: float) -> None:
        self.looks -= 1

    def status(self, node: Node) -> Any:
        closed = self.looks <= 0
        return SimpleNamespace(
            protocol_version=Codec().protocol_version, ready=True, gate_closed=closed, gate_open=False
        )


def test_gate_that_is_still_closing_after_a_stop_is_waited_for() -> None:
    rig: Any = ClosingGate(3)
    make_ready(rig, [Node.HEAD, Node.CURE])
    assert rig.looks == 0
    last: Any = ClosingGate(99)
    make_ready(last, [Node.HEAD])
    assert last.looks == 0, "it is looked at for two seconds"
    late: Any = ClosingGate(100)
    with pytest.raises(NotReady):
        make_ready(late, [Node.HEAD])
    stuck: Any = ClosingGate(math.inf)
    with pytest.raises(NotReady) as raised:
        make_ready(stuck, list(Node))
    assert [line.partition(";")[0] for line in str(raised.value).splitlines()] == [
        "head: the gate is not confirmed closed",
        "cure: the gate is not confirmed closed",
    ]
    assert not any(isinstance(one, tuple) and "CLEAR" in one for one in stuck.log)
