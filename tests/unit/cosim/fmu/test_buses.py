"""Buses of FMUs (FMI-LS-BUS): terminals that the master serves, Event Mode, and operations between two partners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest

from inkloop.component import Values
from inkloop.components.kind import Checked
from inkloop.errors import ComponentError, FmuError, ScenarioError
from inkloop.fmu import FmuComponent
from inkloop.fmu.bus import (
    CONFIGURATION,
    CONFIRM,
    FORMAT_ERROR,
    STATUS,
    WAKEUP,
    BusEnd,
    BusFrame,
    BusLink,
    BusLinks,
    BusNode,
    format_error,
    operation,
    operations,
    transmit,
)
from inkloop.fmu.bus_terminals import BusTerminal, Events, bus_terminals
from inkloop.fmu.reading import describe
from inkloop.fmu_writer.archive import pack, unpack
from inkloop.fmu_writer.documentation import MANIFEST
from inkloop.fmu_writer.export import find_fmu
from inkloop.scenario.file import Scenario
from inkloop.scenario.loop import _bus_links
from inkloop.tables.schema import BusTable
from support.benches.bench_run import BLOCK

CAN = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'
FRAME = BusFrame(0x123, b"abc")
XML = {
    "a": f"""<Binary name="a" valueReference="1" causality="input" clocks="9 2" mimeType='{CAN}'/>""",
    "b": '<Clock name="b" valueReference="2" causality="input" intervalVariability="triggered"/>',
    "c": f"""<Binary name="c" valueReference="3" causality="output" clocks="4" mimeType='{CAN}'/>""",
    "d": '<Clock name="d" valueReference="4" causality="input" intervalVariability="countdown"/>',
}
NETWORK = "org.fmi-ls-bus.network-terminal"


def read(
    old: str = "", new: str = "", kind: str = NETWORK, members: str = "abcd", names: str = "i"
) -> tuple[list[BusTerminal], dict[str, str]]:
    """Terminals with members by letter, of the variables of XML, in which `old` has become `new`."""
    roles = dict(zip("abcde", ("Rx_Data", "Rx_Clock", "Tx_Data", "Tx_Clock", "Rx_Data"), strict=True))
    listed = "".join(f'<TerminalMemberVariable variableName="{m}" memberName="{roles[m]}"/>' for m in members)
    found = "".join(f'<Terminal terminalKind="{kind}" name="{name.strip()}">{listed}</Terminal>' for name in names)
    variables = {name: ElementTree.fromstring(text.replace(old, new)) for name, text in XML.items()}
    return bus_terminals(f"<x><Terminals>{found}</Terminals></x>".encode(), variables)


@pytest.mark.parametrize(
    ("first", "second", "ideal"),
    [(False, False, True), (True, False, False), (False, True, False), (True, True, False)],
)
def test_link_is_ideal_where_neither_end_simulates_the_bus(first: bool, second: bool, ideal: bool) -> None:
    checked = {
        name: Checked("Fmu", buses=["can"], is_bus_simulation=simulates)
        for name, simulates in (("a", first), ("b", second))
    }
    found = _bus_links([BusTable(between=["b.can", "a.can"])], checked)
    assert found == ([BusLink((BusEnd("b", "can"), BusEnd("a", "can")), ideal=ideal)], [])


def test_terminal_that_can_be_served_is_read() -> None:
    assert read() == ([BusTerminal("i", 1, 2, 3, 4, "countdown")], {})
    assert read(kind="org.fmi-ls-bus.signal-frame") == ([], {})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"members": "acd"}, "it has no Rx_Clock"),
        ({"members": "abcde"}, "it has 2 Rx_Data"),
        ({"members": "bcde"}, "its Rx_Data names e, which is no variable of the FMU"),
        ({"names": " "}, "it has no name"),
        ({"names": "ii"}, "its name is that of another bus"),
        ({"old": '<Binary name="c"', "new": '<String name="c"'}, "Tx_Data is (output, String); expected (output, B"),
        ({"old": '"2" causality="input"', "new": '"2"'}, "its Rx_Clock is (local, Clock); expected (input, Clock)"),
        ({"old": "can;", "new": "lin;"}, "this master knows the bus CAN, version 1"),
        ({"old": '"1.0.0"', "new": '"2.0.0"'}, "this master knows the bus CAN, version 1"),
        ({"old": 'clocks="4"', "new": 'clocks="2"'}, "its Tx_Data does not name its Tx_Clock as its clock"),
        ({"old": '"triggered"', "new": '"countdown"'}, "its Rx_Clock is countdown; this master serves triggered ones"),
        ({"old": '"countdown"', "new": '"constant"'}, "its Tx_Clock is constant; this master serves triggered and c"),
    ],
)
def test_terminal_that_cannot_be_served_says_what_is_missing(given, words) -> None:
    _, unserved = read(**given)
    (reason,) = unserved.values()
    assert words in reason


def test_bus_of_an_fmu_without_event_mode_cannot_be_served(tmp_path: Path) -> None:
    assert describe(find_fmu("BenchBus")).unused == {}
    members = unpack(find_fmu("BenchBus"))
    about = members["modelDescription.xml"]
    pack(tmp_path / "it.fmu", members | {"modelDescription.xml": about.replace(b' hasEventMode="true"', b"")})
    described = describe(tmp_path / "it.fmu")
    assert described.buses == ()
    assert described.unserved == {"bench": "the FMU has no Event Mode (hasEventMode)"}


@pytest.mark.parametrize(("word", "simulates"), [("true", True), ("1", True), ("false", False), ("0", False)])
def test_fmu_in_which_the_bus_is_simulated_says_so(word: str, simulates: bool, tmp_path: Path) -> None:
    members = unpack(find_fmu("BenchBus"))
    own = b'isBusSimulationFMU="false"'
    assert own in members[MANIFEST]
    said = members[MANIFEST].replace(own, own.replace(b"false", word.encode()))
    pack(tmp_path / "it.fmu", members | {MANIFEST: said})
    assert describe(tmp_path / "it.fmu").is_bus_simulation is simulates


@pytest.mark.parametrize(
    ("content", "codes"),
    [
        (b"", []),
        (transmit(FRAME) + operation(CONFIRM, bytes(4)), [0x10, 0x20]),
        (transmit(FRAME)[:-1], [0]),
        (operation(0x99, b"") + b"\x01", [0x99, 0]),
        (b"\x10\0\0\0\x07\0\0\0abc", [0]),
    ],
)
def test_operations_are_those_of_the_binary(content, codes) -> None:
    found = list(operations(content))
    assert [each.code for each in found] == codes
    assert b"".join(each.content for each in found) == content


@pytest.mark.parametrize(
    ("frame", "content"),
    [
        (BusFrame(0x123, b"abc"), b"\x10\0\0\0\x13\0\0\0\x23\x01\0\0\0\0\x03\0abc"),
        (BusFrame(0x18DA00F1, bytes(8), True), b"\x10\0\0\0\x18\0\0\0\xf1\0\xda\x18\x01\0\x08\0" + bytes(8)),
        (BusFrame(0x7FF, b"", False, True), b"\x10\0\0\0\x10\0\0\0\xff\x07\0\0\0\x01\0\0"),
    ],
)
def test_frame_is_written_as_the_standard_has_it_and_read_again(frame: BusFrame, content: bytes) -> None:
    assert transmit(frame) == content
    (found,) = operations(content)
    assert found.frame == frame


@pytest.mark.parametrize("data", [bytes(9), b"ab"])
def test_frame_of_another_length_than_it_states_or_than_can_takes_is_none(data: bytes) -> None:
    (found,) = operations(operation(0x10, b"\x23\x01\0\0\0\0" + max(3, len(data)).to_bytes(2, "little") + data))
    assert (found.code, found.frame) == (0x10, None)


@pytest.mark.parametrize(("size", "quoted"), [(300, 300), (0x1_0001, 0xFFFF)])
def test_format_error_quotes_what_its_length_can_count(size: int, quoted: int) -> None:
    (found,) = operations(format_error(size * b"x"))
    assert found.content[8:] == quoted.to_bytes(2, "little") + quoted * b"x"


class Node:
    """A component with one bus, which has something to send at the start and answers what it gets with `answer`."""

    def __init__(self, first: bytes = b"", answer: bytes = b"") -> None:
        self.got, self.answer, self.pending = b"", answer, first

    def exchange(self, received: Mapping[str, bytes]) -> dict[str, bytes]:
        content = received.get("bus", b"")
        self.got += content
        sent, self.pending = self.pending + (self.answer if content else b""), b""
        return {"bus": sent} if sent else {}


def carried(one: Node, other: Node, *, ideal: bool) -> None:
    link = BusLink((BusEnd("one", "bus"), BusEnd("other", "bus")), ideal)
    links = BusLinks({"one": one, "other": other}, [link])
    links.initialized(0, dict[str, Values]())


def test_master_carries_frames_to_the_partner_and_confirms_them() -> None:
    """Frames between a node and its bus stay; unknown operations are answered and go no further."""
    own = operation(CONFIGURATION, b"\1" + bytes(4)) + operation(CONFIRM, bytes(4)) + operation(STATUS, b"\1")
    further = operation(WAKEUP, b"") + format_error(b"?")
    one = Node(transmit(FRAME) + own + further + operation(0x99, b""))
    other = Node()
    carried(one, other, ideal=True)
    assert other.got == transmit(FRAME) + further
    confirm, error = operations(one.got)
    assert confirm.content == operation(CONFIRM, (0x123).to_bytes(4, "little"))
    assert (error.code, error.content[10:]) == (FORMAT_ERROR, operation(0x99, b""))


def test_frames_that_cross_arrive_and_are_confirmed_both() -> None:
    frames = FRAME, BusFrame(0x7, b"xyz")
    one, other = (Node(transmit(frame)) for frame in frames)
    carried(one, other, ideal=True)
    own, others = (operation(CONFIRM, frame.identifier.to_bytes(4, "little")) for frame in frames)
    assert one.got == own + transmit(frames[1])
    assert other.got == transmit(frames[0]) + others


def test_bus_simulation_gets_everything_and_confirms_itself() -> None:
    everything = transmit(FRAME) + operation(CONFIGURATION, b"\1" + bytes(4)) + operation(0x99, b"")
    one, simulation = Node(everything), Node()
    carried(one, simulation, ideal=False)
    assert (simulation.got, one.got) == (everything, b"")


def test_answers_without_end_are_an_error() -> None:
    with pytest.raises(ComponentError, match=r"one.bus and other.bus: .* do not end"):
        carried(Node(transmit(FRAME), transmit(FRAME)), Node(answer=transmit(FRAME)), ideal=True)


class Countdown:
    """A binding of an FMU whose clock (4) ticks `delay` seconds after each frame that it gets, and sends it back."""

    def __init__(self, delay: float) -> None:
        self.delay, self.calls = delay, list[tuple[Any, ...]]()
        self.held, self.asks = b"", False

    def call(self, name: str, *arguments: Any) -> Any:
        self.calls.append((name, *arguments[:2]))
        match name:
            case "setBinary":
                self.held, self.asks = arguments[1][0], True
            case "getBinary":
                return [self.held]
            case "updateDiscreteStates":
                return (False, False)
            case "getIntervalDecimal" if self.asks:
                arguments[1][0], arguments[2][0] = self.delay, 2
                self.asks = False
            case "getIntervalDecimal":
                arguments[2][0] = 1  # unchanged
        return None


@pytest.mark.parametrize("delay", [0.0, 0.25])
def test_countdown_clock_ticks_when_it_is_due(delay) -> None:
    binding = Countdown(delay)
    events = Events(binding.call, [BusTerminal("bus", 1, 2, 3, 4, "countdown")])
    assert events.handle(0.0, {}) == {}
    sent = events.handle(1.0, {"bus": b"frame"})
    assert sent == ({} if delay else {"bus": b"frame"})
    assert events.is_due(1.2) is False
    assert events.is_due(1.25) is bool(delay)
    if delay:
        assert events.handle(1.25, {}) == {"bus": b"frame"}
    assert ("setClock", [4], [True]) in binding.calls
    assert not events.is_due(9.0)


def test_bus_sends_in_every_instant_that_its_clock_ticks_in_and_gets_its_frames_in_the_first() -> None:
    """Event Mode begins with the end of initialisation, later it is entered."""
    calls = list[str]()
    answers: dict[str, list[Any]] = {
        "getClock": [True, True, False, False],
        "getBinary": [b"ab", b"c"],
        "updateDiscreteStates": [1, 1, 0, 0],
    }
    given = {name: iter(values) for name, values in answers.items()}

    def call(name: str, *arguments: Any) -> Any:
        calls.append(name)
        return [next(given[name])] if name in given else None

    events = Events(call, [BusTerminal("bus", 1, 2, 3, 4, "triggered")])
    assert events.handle(0.0, {"bus": b"frame"}) == {"bus": b"abc"}
    instants = ["getClock", "getBinary", "updateDiscreteStates"]
    assert calls == ["setClock", "setBinary", *instants, *instants, "getClock", "updateDiscreteStates", "enterStepMode"]
    calls.clear()
    assert events.handle(1.0, {}) == {}
    assert calls == ["enterEventMode", "getClock", "updateDiscreteStates", "enterStepMode"]


def test_event_mode_without_an_end_is_an_error() -> None:
    events = Events(lambda name, *_: [True], [])
    with pytest.raises(ComponentError, match=r"Event Mode at 2\.5 s does not end: 1000 instants"):
        events.handle(2.5, {})


class Stays:
    """Event Mode of which each stay sends its number; a countdown is due at 9 s."""

    def __init__(self) -> None:
        self.at = list[tuple[float, Mapping[str, bytes]]]()

    def is_due(self, time: float) -> bool:
        return time >= 9.0

    def handle(self, time: float, received: Mapping[str, bytes]) -> dict[str, bytes]:
        self.at.append((time, received))
        return {"bench": str(len(self.at)).encode()}


def test_event_mode_is_stayed_in_at_the_end_of_a_step_and_what_it_sent_is_taken_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After a step that asks for it, and one at whose end a countdown is due."""
    stays, second = Stays(), 10**9
    part, binding = FmuComponent(find_fmu("BenchBus")), MagicMock()
    monkeypatch.setattr(part, "_start", lambda: binding)
    monkeypatch.setattr("inkloop.fmu.component.Events", lambda call, buses: stays)
    binding.do_step.side_effect = [True, False, False]
    part.initialize(2 * second, {})
    for begin in (2, 3, 8):
        part.advance(begin * second, second, {})
    assert part.exchange({"bench": b"x"}) == {"bench": b"1234"}
    assert part.exchange({}) == {}
    assert stays.at == [(2.0, {}), (3.0, {}), (9.0, {}), (9.0, {"bench": b"x"})]
    part.terminate()


BENCH = f'\n[components.{{}}]\nkind = "Fmu"\nfile = "{find_fmu("BenchBus")}"\n'


def scenario(folder: Path, *buses: Sequence[str], names: Sequence[str] = ("one", "other")) -> Path:
    text = BLOCK + "".join(BENCH.format(name) for name in names)
    text += "".join(f"\n[[buses]]\nbetween = {list(ends)}\n" for ends in buses)
    path = folder / "it.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("buses", "words"),
    [
        ([], "components.one: its bus bench has no partner"),
        ([("one.bench", "one.bench")], "buses.[0].between is one.bench, one.bench; expected two different buses"),
        ([("one.bench", "other.bench", "third.bench")], "of more partners each is connected to a bus simulation"),
        ([("one.bench", "other.bus")], "buses.[0].between: other.bus is no bus of an FMU; did you mean other.bench"),
        ([("one.bench", "other.bench"), ("one.bench", "x.y")], "one.bench is in buses.[0] already"),
        ([("x.y", "other.bench"), ("one.bench", "x.z"), ("x.u", "one.bench")], "one.bench is in buses.[1] already"),
    ],
)
def test_errors_of_buses_say_what_is_missing(buses, words, tmp_path) -> None:
    with pytest.raises(ScenarioError) as refused:
        Scenario.load(scenario(tmp_path, *buses))
    assert words in str(refused.value)


def test_two_benches_on_a_bus_hear_each_other() -> None:
    components = {name: FmuComponent(find_fmu("BenchBus"), name=name) for name in ("one", "other")}
    links = BusLinks(components, [BusLink((BusEnd("one", "bench"), BusEnd("other", "bench")), ideal=True)])
    try:
        values = {name: component.initialize(0, {}) for name, component in components.items()}
        links.initialized(0, values)
        for step in range(100):
            values = {name: each.do_step(step * 10**7, 10**7, {}) for name, each in components.items()}
            links.stepped((step + 1) * 10**7, values)
        counts = {name: [int(each[n]) for n in ("frames_sent", "frames_received")] for name, each in values.items()}
        assert counts["one"] == counts["other"]
        sent, received = counts["one"]
        assert sent == received > 40
        assert all(int(each["format_errors"]) == 0 for each in values.values())
    finally:
        for component in components.values():
            component.terminate()


def test_node_without_a_bus_is_refused() -> None:
    with pytest.raises(FmuError, match=r"expected an FMU with one CAN bus \(FMI-LS-BUS\), its buses are none"):
        BusNode(find_fmu("LayerDeposition"), {})
