"""Physical values to frames and back, in Python and by the generated C, and what both refuse."""

from __future__ import annotations

import ctypes
import math
from dataclasses import replace
from typing import Any

import pytest
from cantools.database.can import Message, Signal
from hypothesis import given
from hypothesis import strategies as st

from inkloop_hardware.errors import FrameError
from inkloop_hardware.protocol.c_codec import snake
from inkloop_hardware.protocol.codec import Codec, Frame, Reading
from inkloop_hardware.protocol.records import (
    Fault,
    HeadMeasurement,
    MasterAlive,
    Node,
    NodeFault,
    NodeStatus,
    ProfilerMeasurement,
    Record,
    Source,
    StageMeasurement,
    State,
    StopRequest,
    pack,
    unpack,
)
from support.benches.node_status import IDLE_HEAD
from support.benches.wire_library import wire_library

CODEC = Codec()
MESSAGES = CODEC.database.messages
EVERY_MESSAGE = pytest.mark.parametrize("name", [message.name for message in MESSAGES])
RECORDS: list[Record] = [
    StopRequest(active=True, source=Source.OPERATOR),
    MasterAlive(lamp_enable=True, gate_enable=False, motion_enable=True, session=65535, job=2**32 - 1),
    replace(IDLE_HEAD, node=Node.CURE, lamp_on=True, state=State.CURING, pass_mask=0b1111, layer=300, unknown_mask=2),
    NodeFault(node=Node.HEAD, fault=Fault.BACK_PRESSURE, pass_=3, layer=12, node_time=4.25),
    HeadMeasurement(head_temperature=-40.0, back_pressure=-650.0, droplets=123456),
    StageMeasurement(position_x=0.8, position_y=-0.8, position_z=0.065535),
    ProfilerMeasurement(profiler_temperature=21.37, scan_progress=1.0, valid_share=0.995, scans=9),
]


def own_signals(name: str) -> list[Signal]:
    """The signals that a caller gives."""
    hidden = {"Crc8", "Counter"} if CODEC.data_id(name) else set()
    return [signal for signal in CODEC.message(name).signals if signal.name not in hidden]


def physical(signal: Signal) -> st.SearchStrategy[float]:
    """Any value within the limits, whole ones where the step is 1."""
    highest = 2**signal.length - 1 if signal.maximum is None else signal.maximum
    lowest = signal.minimum or 0
    if signal.scale == 1:
        return st.integers(int(lowest), int(highest))
    return st.floats(lowest, highest)


def struct_of(message: Message) -> type[ctypes.Structure]:
    """The struct that cantools declares for a message."""

    def kind(signal: Signal) -> Any:
        bits = next(bits for bits in (8, 16, 32, 64) if signal.length <= bits)
        return getattr(ctypes, f"c_{'' if signal.is_signed else 'u'}int{bits}")

    fields = [(signal.name, kind(signal)) for signal in message.signals]
    return type(message.name, (ctypes.Structure,), {"_fields_": fields})


def steps_in_c(message: Message, signal: Signal, value: float) -> int:
    """The generated encode function: physical value to steps."""
    encode = wire_library()[f"inkloop_{snake(message.name).lower()}_{snake(signal.name).lower()}_encode"]
    encode.argtypes = [ctypes.c_double]
    encode.restype = dict(struct_of(message)._fields_)[signal.name]  # type: ignore[arg-type]
    return int(encode(value))


def packed_in_c(message: Message, raw: dict[str, int]) -> bytes:
    struct = struct_of(message)(**raw)
    data = ctypes.create_string_buffer(8)
    length = wire_library()[f"inkloop_{snake(message.name).lower()}_pack"](
        data, ctypes.byref(struct), ctypes.c_size_t(8)
    )
    return data.raw[:length]


@pytest.mark.compiled
@EVERY_MESSAGE
@given(data=st.data())
def test_python_and_c_write_the_same_bytes_and_read_them_back(name: str, data: st.DataObject) -> None:
    message, data_id = CODEC.message(name), CODEC.data_id(name)
    values = {signal.name: data.draw(physical(signal), label=signal.name) for signal in own_signals(name)}
    counter = data.draw(st.integers(0, 14)) if data_id else None
    frame = CODEC.encode(name, values, counter)

    raw = {
        signal.name: int(values[signal.name]) if signal.scale == 1 else steps_in_c(message, signal, values[signal.name])
        for signal in own_signals(name)
    }
    in_c = bytearray(packed_in_c(message, raw | ({"Crc8": 0, "Counter": counter} if counter is not None else {})))
    if data_id:
        buffer = (ctypes.c_uint8 * len(in_c)).from_buffer(in_c)
        wire_library().e2e_protect(buffer, ctypes.c_size_t(len(in_c)), ctypes.c_uint16(data_id), counter)
    assert frame == Frame(message.frame_id, bytes(in_c))

    reading = CODEC.decode(frame)
    assert (reading.message, reading.counter, reading.intact) == (name, counter, True)
    struct = struct_of(message)()
    unpack_in_c = wire_library()[f"inkloop_{snake(name).lower()}_unpack"]
    assert unpack_in_c(ctypes.byref(struct), frame.data, ctypes.c_size_t(len(frame.data))) == 0
    for signal in own_signals(name):
        assert abs(reading.values[signal.name] - values[signal.name]) <= signal.scale / 2 * (1 + 1e-9) * (
            signal.scale != 1
        )
        assert getattr(struct, signal.name) == raw[signal.name]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_records_come_back_as_they_were(record: Record) -> None:
    name = f"{record.node}{record.message}" if isinstance(record, NodeStatus | NodeFault) else record.message
    frame = pack(CODEC, record, 5 if CODEC.data_id(name) else None)
    back = unpack(CODEC, CODEC.decode(frame))
    assert type(back) is type(record)
    for field, value in vars(record).items():
        found = getattr(back, field)
        assert type(found) is type(value), field
        assert found == (pytest.approx(value, rel=1e-12, abs=0.0) if isinstance(value, float) else value), field


def test_halves_are_rounded_away_from_zero_as_c_does() -> None:
    for progress, steps in ((0.25, 1), (0.75, 2), (1.25, 3)):
        values = {"ProfilerTemperature": 0, "ScanProgress": progress, "ValidShare": 0, "Scans": 0}
        assert CODEC.encode("ProfilerMeasurement", values).data[2] == steps
    values = {"HeadTemperature": 0, "BackPressure": -2.5, "Droplets": 0}
    assert CODEC.decode(CODEC.encode("HeadMeasurement", values)).values["BackPressure"] == -3


@pytest.mark.parametrize(("value", "expected"), [(200.004, 200.0), (200.006, None), (-40.004, -40.0), (-40.006, None)])
def test_value_beyond_its_limits_that_is_rounded_to_them_is_taken(value: float, expected: float | None) -> None:
    values = {"HeadTemperature": value, "BackPressure": 0, "Droplets": 0}
    if expected is None:
        with pytest.raises(FrameError, match="expected -40 to 200 degC"):
            CODEC.encode("HeadMeasurement", values)
    else:
        found = CODEC.decode(CODEC.encode("HeadMeasurement", values)).values["HeadTemperature"]
        assert found == pytest.approx(expected, rel=1e-12, abs=0.0)


def test_words_of_the_value_table_are_taken_and_given() -> None:
    frame = CODEC.encode("StopRequest", {"Active": "ACTIVE", "Source": "MASTER"}, 0)
    assert CODEC.decode(frame).values == {"Active": 1, "Source": 2}
    assert CODEC.choice("StopRequest", "Source", 2) == "MASTER"
    assert CODEC.choice("StopRequest", "Source", 99) is None
    assert CODEC.choice("MasterAlive", "Job", 1) is None


@pytest.mark.parametrize(
    ("name", "change", "counter", "message"),
    [
        ("MasterAlife", {}, 0, r"no message 'MasterAlife' in the DBC; it has .*MasterAlive"),
        ("MasterAlive", {"Session": 65536}, 0, r"Session is 65536, expected 0 to 65535"),
        ("MasterAlive", {"Session": -1}, 0, r"Session is -1, expected 0 to 65535"),
        ("MasterAlive", {"Session": math.nan}, 0, r"Session is nan, expected 0 to 65535"),
        ("MasterAlive", {"Job": math.inf}, 0, r"Job is inf, expected"),
        ("MasterAlive", {"LampEnable": "MAYBE"}, 0, r"LampEnable is 'MAYBE', expected one of OFF, ON"),
        ("MasterAlive", {"Job": "first"}, 0, r"Job is 'first', expected a number"),
        ("MasterAlive", {"Crc8": 1}, 0, r"message MasterAlive has no signal 'Crc8'"),
        ("MasterAlive", {}, None, r"needs a counter of 0 to 14, found None"),
        ("MasterAlive", {}, 15, r"needs a counter of 0 to 14, found 15"),
        ("HeadMeasurement", {}, 3, r"takes no counter, found 3"),
        (
            "HeadMeasurement",
            {"HeadTemperature": 200.01},
            None,
            r"HeadTemperature is 200.01 degC, expected -40 to 200 degC",
        ),
        ("HeadMeasurement", {"Colour": 1}, None, r"has no signal 'Colour'"),
        (
            "HeadMeasurement",
            {"Droplets": None, "BackPressure": None},
            None,
            "lacks a value for 'BackPressure', lacks a va",
        ),
    ],
)
def test_values_that_do_not_fit_are_refused_with_a_message(
    name: str, change: dict[str, Any], counter: int | None, message: str
) -> None:
    known = name in {one.name for one in MESSAGES}
    values: dict[str, float | str] = {signal.name: 0 for signal in own_signals(name)} if known else {}
    with pytest.raises(FrameError, match=message):
        CODEC.encode(name, {key: each for key, each in (values | change).items() if each is not None}, counter)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (Frame(0x7FF, b""), r"frame 0x7FF \[0\] : no message with this id"),
        (Frame(0x111, bytes(7)), r"HeadMeasurement has 7 bytes, expected 8"),
        (Frame(0x020, bytes(9)), r"MasterAlive has 9 bytes, expected 8"),
        (Frame(0x111, bytes.fromhex("ff7f000000000000")), r"HeadTemperature is 327.67 degC, expected -40 to 200 degC"),
    ],
)
def test_frames_that_do_not_fit_are_refused_with_a_message(frame: Frame, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        CODEC.decode(frame)


@given(bit=st.integers(0, 63), counter=st.integers(0, 14), job=st.integers(0, 2**32 - 1))
def test_one_flipped_bit_is_noticed_and_nothing_is_read_from_the_frame(bit: int, counter: int, job: int) -> None:
    alive = MasterAlive(lamp_enable=True, gate_enable=True, motion_enable=True, session=1, job=job)
    frame = pack(CODEC, alive, counter)
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    reading = CODEC.decode(Frame(frame.arbitration_id, bytes(data)))
    assert (reading.intact, reading.values) == (False, {})
    with pytest.raises(FrameError, match="is damaged"):
        unpack(CODEC, reading)


def test_frame_of_another_message_is_not_taken_for_this_one() -> None:
    """The data id is in the check byte: a status sent with the wrong id is damaged."""
    status = CODEC.encode("HeadStatus", {signal.name: 0 for signal in own_signals("HeadStatus")}, 3)
    assert not CODEC.decode(Frame(0x102, status.data)).intact


def test_value_of_a_newer_protocol_is_an_error() -> None:
    values = {signal.name: 0 for signal in own_signals("HeadFault")} | {"Fault": 200}
    with pytest.raises(FrameError, match="Fault is 200, which version 1 of the protocol does not know"):
        unpack(CODEC, CODEC.decode(CODEC.encode("HeadFault", values)))
    with pytest.raises(FrameError, match="message HeadRequest has no record"):
        unpack(CODEC, Reading("HeadRequest", {}))
