"""A tester of others that knows only the PDX file sends what our link sends, and reads what our link reads."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

import numpy as np
import odxtools
import pytest
from odxtools.database import Database
from odxtools.diaglayers.ecuvariant import EcuVariant
from udsoncan.ResponseCode import ResponseCode

from inkloop.cli import main
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.link import Link
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Identifier, TransferFlags, TransferState
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import REFUSALS, ClearOption, Key, Outcome, Routine, Station
from support.benches.faulty_wire import NODES, FaultyWire
from support.benches.node_bench import NodeBench, pattern_blob, run_length

KEY = Key(0x01020304, 0x0506, 3, 9)
KEY_VALUES = {"job": 0x01020304, "layer": 0x0506, "pass": 3, "attempt": 9}
REFUSED, NOT_THERE, NOT_KNOWN = 0x7F, 0x11, 0x31
"""First byte of a refusal; the codes for a service, and for an identifier or a routine, that a node does not have."""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pdx") / "nodes.pdx"
    assert main(["export", "services", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def nodes(file: Path) -> Database:
    return odxtools.load_pdx_file(file)


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made.ready()


def asked(bench: NodeBench, node: Node, act: Callable[[Link], Any]) -> tuple[list[tuple[bytes, bytes]], Any]:
    """Requests of our link with their first answers, and what it made of them; None for an error."""
    found: list[tuple[bytes, bytes]] = []
    wire = FaultyWire(bench, NODES.index(node))
    real = bench.raw

    def raw(request: bytes, *place: Any) -> bytes:
        found.append((request, real(request, *place)))
        return found[-1][1]

    with pytest.MonkeyPatch.context() as patch, suppress(HardwareError):
        patch.setattr(bench, "raw", raw)
        return found, act(wire.link())
    return found, None


def encoded(node: EcuVariant, service: str, values: dict[str, Any]) -> bytes:
    return bytes(node.services[service](**values))


def decoded(node: EcuVariant, service: str, request: bytes, answer: bytes) -> dict[str, Any]:
    """Values that a tester reads in an answer to a service."""
    (found,) = [one for one in node.decode_response(answer, request) if one.service.short_name == service]
    return {name: without_noise(value) for name, value in found.param_dict.items()}


def without_noise(value: Any) -> Any:
    """Times to the nanosecond: a tester multiplies by 0.001, we divide by 1000."""
    if isinstance(value, dict):
        return {name: without_noise(one) for name, one in value.items()}
    if isinstance(value, list):
        return [without_noise(one) for one in value]
    return round(value, 9) if isinstance(value, float) else value


def as_odx(record: Any) -> dict[str, Any]:
    """A record of ours as a tester reads it: words of enumerations, and a number for each flag."""
    found: dict[str, Any] = {}
    for field in fields(record):
        name, value = field.name.rstrip("_"), getattr(record, field.name)
        if isinstance(value, IntFlag):
            found |= {f"{name}_{flag.name.lower()}": int(flag in value) for flag in type(value)}
        else:
            found[name] = value.name if isinstance(value, IntEnum) else without_noise(value)
    return found


def start(routine: Routine, option: bytes = b"") -> Callable[[Link], Outcome]:
    return lambda link: link.routine(routine, KEY, option, limit_s=5.0)


def ask(routine: Routine) -> Callable[[Link], Outcome]:
    return lambda link: link.ask(routine, KEY)


BOTH = ClearOption.OPERATOR | ClearOption.ABANDON
READS: dict[Identifier, tuple[Node, Callable[[Link], Any]]] = {
    Identifier.STATE: (Node.HEAD, Link.state),
    Identifier.TIMES: (Node.CURE, Link.times),
    Identifier.LIMITS: (Node.STAGE, Link.limits),
    Identifier.MAP: (Node.PROFILER, Link.map_size),
    Identifier.JOURNAL: (Node.HEAD, Link.journal),
    Identifier.VERSION: (Node.STAGE, Link.version),
}
STEPS = [
    (Node.HEAD, "Clear", start(Routine.CLEAR, bytes([BOTH])), {"option_operator": 1, "option_abandon": 1}),
    (Node.CURE, "Clear", start(Routine.CLEAR, bytes([1])), {"option_operator": 1, "option_abandon": 0}),
    (Node.STAGE, "Home", start(Routine.HOME), {}),
    (Node.HEAD, "Purge", start(Routine.PURGE), {}),
    (Node.HEAD, "Pass", start(Routine.PASS, bytes([2])), {"colour": 2}),
    (Node.CURE, "Cure", start(Routine.CURE, (1020).to_bytes(2, "big")), {"duration": 1.02}),
    (Node.PROFILER, "Scan", start(Routine.SCAN), {}),
    (Node.STAGE, "DryRun", start(Routine.DRY_RUN, bytes([1])), {"on": 1}),
    (Node.STAGE, "Move", start(Routine.MOVE, bytes([Station.SCAN])), {"station": "SCAN"}),
    (Node.CURE, "SelfTest", start(Routine.SELF_TEST, (40).to_bytes(2, "big")), {"lamp_time": 0.04}),
]


@pytest.mark.compiled
@pytest.mark.parametrize("identifier", READS)
def test_identifiers_are_asked_and_read_alike(identifier: Identifier, bench: NodeBench, nodes: Database) -> None:
    node, read = READS[identifier]
    bench.print_layer(np.ones((9, 8)), 1)
    assert bench.clear(option=1) == 0, "its record has a flag"
    ((request, answer),), record = asked(bench, node, read)
    service = f"Read{identifier.name.title()}"
    assert encoded(nodes.ecus[node], service, {}) == request
    found = decoded(nodes.ecus[node], service, request, answer)
    assert (found.pop("service"), found.pop("identifier")) == (0x62, identifier)
    if identifier is Identifier.JOURNAL:
        assert found == {"records": [as_odx(one) for one in record]}
        assert len(record) > 4
    elif identifier is Identifier.VERSION:
        assert found == {"version": record}
    else:
        assert found == as_odx(record)


@pytest.mark.compiled
@pytest.mark.parametrize(("node", "name", "act", "option"), STEPS)
def test_routines_are_started_alike(
    node: Node, name: str, act: Callable[[Link], Any], option: dict[str, Any], bench: NodeBench, nodes: Database
) -> None:
    found, _ = asked(bench, node, act)
    request, answer = found[0]
    assert encoded(nodes.ecus[node], f"Start{name}", KEY_VALUES | option) == request
    read = decoded(nodes.ecus[node], f"Start{name}", request, answer)
    if answer[0] == REFUSED:
        assert read == {"service": REFUSED, "refused": 0x31, "code": ResponseCode.get_name(answer[2])}
    else:
        number = int.from_bytes(request[2:4], "big")
        assert read == {"service": 0x71, "kind": 1, "routine": number, "outcome": Outcome(answer[4]).name} | KEY_VALUES


def test_all_routines_and_all_their_options_are_started_in_these_tests() -> None:
    assert {name for _, name, _, _ in STEPS} == {routine.name.title().replace("_", "") for routine in Routine}
    assert set(READS) == set(Identifier) - {Identifier.TRANSFER, Identifier.SESSION}


@pytest.mark.compiled
@pytest.mark.parametrize(("routine", "node"), [(Routine.PASS, Node.HEAD), (Routine.SELF_TEST, Node.CURE)])
def test_outcomes_are_asked_and_read_alike(routine: Routine, node: Node, bench: NodeBench, nodes: Database) -> None:
    ((request, answer),), outcome = asked(bench, node, ask(routine))
    service = f"Ask{routine.name.title().replace('_', '')}"
    assert encoded(nodes.ecus[node], service, KEY_VALUES) == request
    read = decoded(nodes.ecus[node], service, request, answer)
    assert (read["outcome"], outcome) == ("NEVER", Outcome.NEVER)
    assert {name: read[name] for name in KEY_VALUES} == KEY_VALUES


@pytest.mark.compiled
def test_pattern_is_sent_alike(bench: NodeBench, nodes: Database) -> None:
    head, blob = nodes.ecus.Head, pattern_blob(np.ones((9, 8)))
    (begin, block, end), _ = asked(bench, Node.HEAD, lambda link: link.download(1, blob))
    place = {"layer": 1, "size": len(blob)}
    assert encoded(head, "RequestDownload", {"coding": "PLAIN"} | place) == begin[0]
    assert encoded(head, "TransferBlock", {"counter": 1, "data": blob}) == block[0]
    assert encoded(head, "TransferEnd", {"crc": zlib.crc32(blob)}) == end[0]
    assert decoded(head, "RequestDownload", *begin)["block"] == 4095
    assert decoded(head, "TransferBlock", *block) == {"service": 0x76, "counter": 1}
    assert decoded(head, "TransferEnd", *end)["crc"] == zlib.crc32(blob)
    coded = run_length(blob)
    (begin, *_), _ = asked(bench, Node.HEAD, lambda link: link.download(1, coded, coded=True))
    assert encoded(head, "RequestDownload", {"coding": "RUN_LENGTH", "layer": 1, "size": len(coded)}) == begin[0]


@pytest.mark.compiled
def test_map_is_read_alike(bench: NodeBench, nodes: Database) -> None:
    profiler = nodes.ecus.Profiler
    assert bench.scan(0) == 0
    (size, begin, block, end), blob = asked(bench, Node.PROFILER, lambda link: link.upload(0))
    found = decoded(profiler, "ReadMap", *size)
    assert encoded(profiler, "RequestUpload", {"layer": 0, "size": found["size"]}) == begin[0]
    assert encoded(profiler, "TransferBlock", {"counter": 1}) == block[0]
    assert encoded(profiler, "TransferEnd", {}) == end[0]
    assert decoded(profiler, "RequestUpload", *begin)["block"] == 4095
    assert decoded(profiler, "TransferBlock", *block)["data"] == blob
    assert decoded(profiler, "TransferEnd", *end)["crc"] == zlib.crc32(blob)
    assert encoded(profiler, "TransferBlockOfAtMost", {"counter": 2, "most": 300}) == bytes.fromhex("36 02 012c")


@pytest.mark.compiled
def test_progress_sessions_and_presence_are_read(bench: NodeBench, nodes: Database) -> None:
    head = nodes.ecus.Head

    def exchange(service: str, **values: Any) -> dict[str, Any]:
        request = encoded(head, service, values)
        return decoded(head, service, request, bench.raw(request))

    assert exchange("ReadTransfer")["flags_active"] == 0
    bench.ask(encoded(head, "RequestDownload", {"coding": "PLAIN", "layer": 1, "size": 26}))
    state = TransferState(TransferFlags.ACTIVE, 1, 1, 7, 0, 26)
    assert exchange("ReadTransfer").items() >= as_odx(state).items()
    assert exchange("Session", session="EXTENDED").items() >= {"p2": 1.0, "p2_star_in_10_ms": 500}.items()
    assert exchange("ReadSession")["session"] == "EXTENDED"
    assert exchange("TesterPresent") == {"service": 0x7E, "subfunction": 0}


@pytest.mark.compiled
@pytest.mark.parametrize("node", Node)
def test_each_node_has_the_services_of_the_file_and_no_others(node: Node, bench: NodeBench, nodes: Database) -> None:
    def there(request: bytes, missing: int) -> bool:
        answer = bench.raw(request, NODES.index(node))
        return answer[0] != REFUSED or answer[2] != missing

    sent = [encoded_head(service) for service in nodes.ecus[node].services]
    assert {head[0] for head in sent} == {one for one in range(0x100) if there(bytes([one]), NOT_THERE)}
    asked_of = [range(0x0080, 0x0180), range(0xF180, 0xF1A0)]
    identifiers = {one for some in asked_of for one in some if there(b"\x22" + one.to_bytes(2, "big"), NOT_KNOWN)}
    assert {int.from_bytes(head[1:3], "big") for head in sent if head[0] == 0x22} == identifiers
    routines = {one for one in range(0x01C0, 0x0240) if there(b"\x31\x01" + one.to_bytes(2, "big"), NOT_KNOWN)}
    assert {int.from_bytes(head[2:4], "big") for head in sent if head[0] == 0x31} == routines


def encoded_head(service: Any) -> bytes:
    """The bytes of a request that are the same in each."""
    return bytes(service.request.coded_const_prefix())


def test_each_refusal_has_a_name_and_a_remedy(nodes: Database) -> None:
    request = encoded(nodes.ecus.Stage, "ReadState", {})
    for code in REFUSALS:
        found = decoded(nodes.ecus.Stage, "ReadState", request, bytes([REFUSED, 0x22, code]))
        assert found == {"service": REFUSED, "refused": 0x22, "code": ResponseCode.get_name(code)}
    (kind,) = [
        one
        for one in nodes.base_variants.Node.diag_data_dictionary_spec.data_object_props
        if one.short_name == "RefusalCode"
    ]
    scales = kind.compu_method.compu_internal_to_phys.compu_scales
    assert [scale.description.text for scale in scales] == [f"<p>{why}</p>" for why in REFUSALS.values()]


@pytest.mark.parametrize("node", Node)
def test_file_has_the_arbitration_ids_and_the_bit_rate_of_the_dbc(node: Node, nodes: Database) -> None:
    ecu, codec = nodes.ecus[node], Codec()
    found = ecu.get_can_receive_id(), ecu.get_can_send_id(), ecu.get_can_baudrate()
    assert found == (codec.request_id(node), codec.answer_id(node), 500_000)


def test_file_that_cannot_be_written_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["export", "services", str(tmp_path / "file" / "nodes.pdx")]) != 0
    assert "nodes.pdx" in capsys.readouterr().err
