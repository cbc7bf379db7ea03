"""The DBC of the bench: complete, consistent, and the only source of codec, records and page."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import fields
from enum import IntEnum
from pathlib import Path

import pytest
from cantools.database.can import Message

from inkloop_hardware.errors import FrameError
from inkloop_hardware.protocol.c_codec import write_codec
from inkloop_hardware.protocol.codec import BENCH_DBC, Codec
from inkloop_hardware.protocol.records import KINDS, SI, Fault, Node, Source, State, signal_name
from support.benches.node_bench import codec

CODEC = Codec()
MESSAGES = CODEC.database.messages
BIT_RATE = 500_000
STATUS_SIGNALS = [signal.name for signal in CODEC.message("CureStatus").signals[2:]]
EVERY_MESSAGE = pytest.mark.parametrize("message", MESSAGES, ids=[message.name for message in MESSAGES])


def test_ids_and_cycles_are_those_of_the_bench() -> None:
    ids = {message.name: message.frame_id for message in MESSAGES}
    assert len(set(ids.values())) == len(MESSAGES)
    assert (ids["StopRequest"], ids["MasterAlive"]) == (0x010, 0x020)
    assert ids["StopRequest"] == min(ids.values())  # nothing wins arbitration against it
    for place, node in enumerate(Node):
        assert (ids[f"{node}Status"], ids[f"{node}Measurement"], ids[f"{node}Fault"]) == (
            0x101 + place,
            0x111 + place,
            0x181 + place,
        )
        assert (CODEC.request_id(node), CODEC.answer_id(node)) == (0x640 + 2 * place, 0x641 + 2 * place)
        assert CODEC.cycle_time(f"{node}Status") == 0.1
        assert CODEC.cycle_time(f"{node}Request") is None
    assert CODEC.cycle_time("MasterAlive") == 0.1
    assert CODEC.protocol_version == 1


VERSION_1 = {
    "StopRequest": "Crc8 0|8 0-255, Counter 8|4 0-14, Active 12|1 0-1, Source 16|8 0-255",
    "MasterAlive": "Crc8 0|8 0-255, Counter 8|4 0-14, LampEnable 12|1 0-1, GateEnable 13|1 0-1, MotionEnable 14|1 0-1, "
    "Session 16|16 0-65535, Job 32|32 0-4294967295",
    "Status": "Crc8 0|8 0-255, Counter 8|4 0-14, LampOn 12|1 0-1, GateOpen 13|1 0-1, GateClosed 14|1 0-1, "
    "Ready 15|1 0-1, State 16|4 0-10, PassMask 20|4 0-15, Fault 24|8 0-255, Layer 32|16 0-65535, BootCount 48|8 0-255, "
    "UnknownMask 56|4 0-15, ProtocolVersion 60|4 0-15",
    "Fault": "Fault 0|8 0-255, Pass 8|4 0-15, Layer 16|16 0-65535, NodeTime 32|32 0-4294967295 1 ms",
    "HeadMeasurement": "HeadTemperature 0|16 -40-200 0.01 degC, BackPressure 16|16 -20000-20000 1 Pa, "
    "Droplets 32|32 0-4294967295",
    "StageMeasurement": "PositionX 0|24 -800000-800000 0.1 um, PositionY 24|24 -800000-800000 0.1 um, "
    "PositionZ 48|16 0-65535 1 um",
    "CureMeasurement": "Irradiance 0|16 0-655350 10 W/m2, LampTemperature 16|16 -40-200 0.01 degC, "
    "LampTime 32|32 0-4294967295 1 ms",
    "ProfilerMeasurement": "ProfilerTemperature 0|16 -40-200 0.01 degC, ScanProgress 16|8 0-100 0.5 %, "
    "ValidShare 24|8 0-100 0.5 %, Scans 32|16 0-65535",
}
"""Signal, first bit and bits, limits, step and unit of the frames of version 1, which nodes of this version have."""
CYCLES_1 = {"StopRequest": 0.05, "HeadMeasurement": 0.2, "StageMeasurement": 0.2, "CureMeasurement": 0.5}


@EVERY_MESSAGE
def test_frames_of_version_1_lie_as_nodes_in_the_field_have_them(message: Message) -> None:
    """Both sides are made from the file: they would agree on any other layout, but with no older node."""
    name = re.sub("^(Head|Stage|Cure|Profiler)(?=Status|Fault)", "", message.name)
    if name not in VERSION_1:
        assert message.signals[0].name == "IsoTpLow"
        return
    found = []
    for signal in message.signals:
        unit = f" {signal.scale:g} {signal.unit}" if signal.unit else ""
        limits = f"{signal.minimum:.0f}-{signal.maximum:.0f}"
        found.append(f"{signal.name} {signal.start}|{signal.length} {limits}{unit}")
        assert (signal.byte_order, signal.offset, signal.is_float) == ("little_endian", 0, False)
        assert signal.is_signed == ((signal.minimum or 0) < 0)
        assert signal.unit or signal.scale == 1
    assert ", ".join(found) == VERSION_1[name]
    assert CODEC.data_id(message.name) in (None, message.frame_id)
    assert CODEC.cycle_time(message.name) == CYCLES_1.get(name, 0.1 if name in ("MasterAlive", "Status") else 1.0)


@EVERY_MESSAGE
def test_every_signal_has_a_comment_and_a_known_unit(message: Message) -> None:
    assert message.comment
    assert message.senders
    for signal in message.signals:
        assert signal.comment, signal.name
        assert (signal.unit or "") in SI, signal.name
        assert signal.receivers, signal.name


@pytest.mark.parametrize("words", [State, Fault, Source], ids=lambda words: words.__name__)
def test_enumerations_are_the_value_tables(words: type[IntEnum]) -> None:
    dbc = CODEC.database.dbc
    assert dbc is not None
    expected = {word.value: word.name for word in words}
    assert {number: str(word) for number, word in dbc.value_tables[words.__name__].items()} == expected
    for message in MESSAGES:
        for signal in message.signals:
            if signal.name == words.__name__:
                assert signal.choices is not None
                assert {number: str(word) for number, word in signal.choices.items()} == expected, message.name


@pytest.mark.parametrize("name", sorted(KINDS))
def test_fields_of_a_record_are_the_signals_of_its_message(name: str) -> None:
    kind, _ = KINDS[name]
    ours = {signal_name(field.name) for field in fields(kind) if field.name != "node"}
    assert ours == {signal.name for signal in CODEC.message(name).signals} - {"Crc8", "Counter"}


def test_every_message_but_those_of_isotp_has_a_record() -> None:
    assert set(KINDS) == {message.name for message in MESSAGES if message.signals[0].name != "IsoTpLow"}


def test_cyclic_frames_leave_the_bus_to_the_patterns() -> None:
    """A frame of n bytes has at most 47 + 8 n bits and 1 stuff bit to 4 of 34 + 8 n."""
    load = 0.0
    for message in MESSAGES:
        if message.send_type == "Cyclic" and message.cycle_time:
            bits = 47 + 8 * message.length + (34 + 8 * message.length - 1) // 4
            load += bits / (message.cycle_time / 1e3) / BIT_RATE
    assert 0.01 < load < 0.03


@pytest.mark.system
@pytest.mark.compiled
def test_generated_c_is_the_same_each_time_and_has_no_date(tmp_path: Path) -> None:
    first = write_codec(BENCH_DBC, tmp_path)
    assert [path.name for path in first] == ["inkloop.h", "inkloop.c", "inkloop_protocol.h"]
    for one in first:
        assert one.read_bytes() == (codec() / one.name).read_bytes()  # which other tests have written
        assert not re.search(r"\d\d:\d\d:\d\d|(?<!-)\b202\d\b", one.read_text("utf-8"))


@pytest.mark.system
def test_stock_cantools_reads_a_log_of_the_bus() -> None:
    status = CODEC.encode("CureStatus", dict.fromkeys(STATUS_SIGNALS, 0) | {"State": "CURING", "LampOn": "ON"}, 4)
    line = f"  can0  {status.arbitration_id:03X}   [8]  {status.data.hex(' ').upper()}\n"
    command = [sys.executable, "-m", "cantools", "decode", str(BENCH_DBC)]
    decoded = subprocess.run(command, input=line, capture_output=True, text=True, check=True).stdout
    assert "CureStatus" in decoded
    assert "State: CURING" in decoded
    assert "LampOn: ON" in decoded


def test_file_that_is_no_dbc_is_refused_with_a_message(tmp_path: Path) -> None:
    broken = tmp_path / "broken.dbc"
    broken.write_text("BO_ what\n")
    with pytest.raises(FrameError, match=r"broken\.dbc cannot be read as a DBC"):
        Codec(broken)
    with pytest.raises(FrameError, match="cannot be read as a DBC"):
        Codec(tmp_path / "missing.dbc")
