"""Buses of FMUs (FMI-LS-BUS): terminals that the master serves, Event Mode, and operations between two partners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from inkloop.component import Values
from inkloop.errors import ComponentError, FmuError, ScenarioError
from inkloop.fmu import FmuComponent
from inkloop.fmu.bus import (
    CONFIGURATION,
    CONFIRM,
    FORMAT_ERROR,
    BusEnd,
    BusFrame,
    BusLink,
    BusLinks,
    BusNode,
    operation,
    operations,
    transmit,
)
from inkloop.fmu.bus_terminals import BusTerminal, Events, MemberVariable, bus_terminals
from inkloop.fmu_writer.export import find_fmu
from inkloop.scenario.file import Scenario
from support.benches.bench_run import BLOCK

CAN = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'
FRAME = BusFrame(0x123, b"abc")
GOOD = {
    "a": MemberVariable(1, "Binary", None, CAN),
    "b": MemberVariable(2, "Clock", "triggered"),
    "c": MemberVariable(3, "Binary", None, CAN),
    "d": MemberVariable(4, "Clock", "countdown"),
}
LIN = CAN.replace("can;", "lin;")


def terminals(kind: str = "org.fmi-ls-bus.network-terminal", members: str = "abcd") -> bytes:
    roles = dict(zip("abcd", ("Rx_Data", "Rx_Clock", "Tx_Data", "Tx_Clock"), strict=True))
    listed = "".join(f'<TerminalMemberVariable variableName="{m}" memberName="{roles[m]}"/>' for m in members)
    return f'<x><Terminals><Terminal terminalKind="{kind}" name="it">{listed}</Terminal></Terminals></x>'.encode()


def test_terminal_that_can_be_served_is_read() -> None:
    assert bus_terminals(terminals(), GOOD) == ([BusTerminal("it", 1, 2, 3, 4, "countdown")], {})
    assert bus_terminals(terminals("org.fmi-ls-bus.signal-frame"), GOOD) == ([], {})


@pytest.mark.parametrize(
    ("members", "changes", "words"),
    [
        ("acd", {}, "has no Rx_Clock"),
        ("abcd", {"c": MemberVariable(3, "String")}, "Tx_Data is a String; expected a Binary"),
        ("abcd", {"a": MemberVariable(1, "Binary", None, LIN)}, "this master knows the bus CAN"),
        ("abcd", {"b": MemberVariable(2, "Clock", "countdown")}, "Rx_Clock is countdown; expected triggered"),
        ("abcd", {"d": MemberVariable(4, "Clock", "constant")}, "serves triggered and countdown ones"),
    ],
)
def test_terminal_that_cannot_be_served_says_what_is_missing(members, changes, words) -> None:
    served, unserved = bus_terminals(terminals(members=members), GOOD | changes)
    assert not served
    assert words in unserved["it"]


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
    """Configurations stay; what is no operation is answered and goes no further."""
    one = Node(transmit(FRAME) + operation(CONFIGURATION, b"\1" + bytes(4)) + operation(0x99, b""))
    other = Node()
    carried(one, other, ideal=True)
    assert other.got == transmit(FRAME)
    confirm, error = operations(one.got)
    assert confirm.content == operation(CONFIRM, (0x123).to_bytes(4, "little"))
    assert (error.code, error.content[10:]) == (FORMAT_ERROR, operation(0x99, b""))


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
        ([("one.bench", "one.bench")], "buses.[0].between has 1 ends; expected two different ones"),
        ([("one.bench", "other.bus")], "buses.[0].between: other.bus is no bus of an FMU; did you mean other.bench"),
        ([("one.bench", "other.bench"), ("one.bench", "x.y")], "one.bench is in buses.[0] already"),
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
