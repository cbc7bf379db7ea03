"""Frames of DBCs of others, read as their files mean them: miniatures with the features of public ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from inkloop.testing import job as small_job
from inkloop_hardware.bus.isotp_connection import without_reserved_gap
from inkloop_hardware.errors import FrameError
from inkloop_hardware.mapped.mapping_file import load
from inkloop_hardware.protocol.codec import EXTENDED, Codec, Frame, Reading

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: Pc Plc\n'
SCALED = """BO_ 544 PlcState: 4 Plc
 SG_ State : 0|8@1+ (0.5,-10) [-10|50] "" Pc
 SG_ Level : 8|8@1+ (1,0) [0|100] "%" Pc
 SG_ Angle : 16|12@1- (0.1,0) [-180|180] "deg" Pc
VAL_ 544 State 1 "IDLE" 2 "READY" 255 "NOT_AVAILABLE" ;
"""
MOTOROLA = """BO_ 2566848560 Axis: 12 Plc
 SG_ Mode M : 7|4@0+ (1,0) [0|15] "" Pc
 SG_ Speed m1 : 15|16@0- (0.01,0) [-300|300] "mm/s" Pc
 SG_ Which m2M : 15|8@0+ (1,0) [0|255] "" Pc
 SG_ Torque m7 : 23|32@0- (1,0) [0|0] "Nm" Pc
SG_MUL_VAL_ 2566848560 Speed Mode 1-1;
SG_MUL_VAL_ 2566848560 Which Mode 2-2;
SG_MUL_VAL_ 2566848560 Torque Which 7-7;
SIG_VALTYPE_ 2566848560 Torque : 1;
"""
FORMATS = ",".join(f'"{name}"' for name in ("StandardCAN", "ExtendedCAN", *"23456789abcd", "StandardCAN_FD"))
CLUSTER = f"""BO_ 1056 Cluster: 64 Plc
 SG_ Torque : 7|12@0- (0.25,0) [-512|511.75] "Nm" Pc
 SG_ Speed : 11|16@0+ (0.01,0) [0|600] "km/h" Pc
 SG_ Gear : 27|4@0+ (1,-2) [-2|8] "" Pc
 SG_ Steering : 499|12@0- (0.5,0) [-900|900] "deg" Pc
BA_DEF_ BO_  "VFrameFormat" ENUM  {FORMATS};
BA_DEF_DEF_  "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 1056 14;
VAL_ 1056 Gear 0 "REVERSE" 2 "NEUTRAL" 15 "NOT_VALID" ;
"""
UNLIMITED = """BO_ 545 Plain: 4 Plc
 SG_ Up : 0|8@1+ (1,0) [0|0] "" Pc
 SG_ Both : 8|8@1- (0.5,10) [0|0] "V" Pc
 SG_ Down : 16|8@1+ (-2,0) [0|0] "" Pc
 SG_ Shifted : 24|8@1+ (1,100) [0|0] "" Pc
"""
OVERLAPPING = 'BO_ 100 Odd: 2 Plc\n SG_ One : 0|8@1+ (1,0) [0|255] "" Pc\n SG_ Two : 4|8@1+ (1,0) [0|255] "" Pc\n'


def codec(folder: Path, messages: str, **options: Any) -> Codec:
    (folder / "others.dbc").write_text(HEAD + messages)
    return Codec(folder / "others.dbc", **options)


def read(codec: Codec, data: bytes, **frame: Any) -> Reading:
    return codec.decode(Frame(544, data, **frame), strict=False)


@pytest.mark.parametrize(("raw", "name"), [(1, "IDLE"), (2, "READY"), (255, "NOT_AVAILABLE"), (3, None), (0, None)])
def test_names_of_a_scaled_signal_belong_to_raw_values(raw: int, name: str | None, tmp_path: Path) -> None:
    """Also where the value of a name is beyond the limits, as 117.5 here."""
    of = codec(tmp_path, SCALED)
    value = read(of, bytes([raw, 0, 0, 0])).values["State"]
    assert value == pytest.approx(0.5 * raw - 10.0, rel=0.0, abs=1e-12)
    assert of.choice("PlcState", "State", value) == name
    if name is not None:
        assert of.encode("PlcState", {"State": name, "Level": 0, "Angle": 0}).data[0] == raw


def test_value_that_lies_between_two_raw_ones_has_no_name(tmp_path: Path) -> None:
    of = codec(tmp_path, SCALED)
    for value in (-9.4, float("nan"), float("inf")):
        assert of.choice("PlcState", "State", value) is None


def test_signal_beyond_its_limits_drops_itself_alone(tmp_path: Path) -> None:
    of, data = codec(tmp_path, SCALED), bytes([2, 101, 0xFF, 0xFF])
    found = read(of, data)
    assert found.values == {
        "State": pytest.approx(-9.0, rel=0.0, abs=1e-9),
        "Angle": pytest.approx(-0.1, rel=0.0, abs=1e-9),
    }
    assert found.dropped == {"Level": "message PlcState: Level is 101 %, expected 0 to 100 %"}
    with pytest.raises(FrameError, match="Level is 101 %"):
        of.decode(Frame(544, data))  # of our own protocol


def test_longer_and_fd_frames_are_read_and_shorter_ones_are_not(tmp_path: Path) -> None:
    of, data = codec(tmp_path, SCALED), bytes([2, 7, 0, 0])
    with pytest.raises(FrameError, match=r"0x220 .* is a CAN FD frame, expected a classic one"):
        of.decode(Frame(544, data, is_fd=True))
    for frame in (Frame(544, data), Frame(544, data + b"\xcc\xcc"), Frame(544, data, is_fd=True)):
        assert of.decode(frame, strict=False).values["Level"] == 7.0
    with pytest.raises(FrameError, match="has 3 bytes, expected 4"):
        read(of, data[:3])


def test_padding_does_not_spoil_the_check_byte() -> None:
    """Of a supervised frame; a wrong check byte still leaves no value."""
    of = Codec()
    frame = of.encode("StopRequest", {"Active": 1, "Source": 1}, 3)
    padded = Frame(frame.arbitration_id, frame.data + b"\xcc\xcc")
    assert of.decode(padded, strict=False).values == of.decode(frame).values != {}
    spoilt = Frame(frame.arbitration_id, bytes([frame.data[0] ^ 1]) + frame.data[1:])
    assert not of.decode(spoilt, strict=False).intact


def test_cascaded_multiplex_with_long_ids_motorola_order_and_floats(tmp_path: Path) -> None:
    of = codec(tmp_path, MOTOROLA)
    axis = EXTENDED | 0x18FF0030
    speed = of.decode(Frame(axis, bytes([0x10, 0xFE, 0x0C]) + bytes(9), is_fd=True), strict=False)
    assert speed.values == {"Mode": 1.0, "Speed": pytest.approx(-5.0, rel=0.0, abs=1e-9)}
    torque = of.decode(Frame(axis, bytes([0x20, 7, 0xC0, 0x20, 0, 0]) + bytes(6), is_fd=True), strict=False)
    assert torque.values["Torque"] == -2.5
    with pytest.raises(FrameError, match=r"frame 0x030 .*no message with this id"):
        of.decode(Frame(0x30, bytes(12), is_fd=True))
    sent = of.encode("Axis", {"Mode": 2, "Which": 7, "Torque": -2.5})
    assert sent == Frame(axis, bytes([0x20, 7, 0xC0, 0x20, 0, 0]) + bytes(6), is_fd=True)
    for values, message in (
        ({"Mode": 2, "Which": 7}, "message Axis lacks a value for 'Torque', by its multiplexer"),
        ({"Mode": 9}, "message Axis cannot be encoded: .*Mode"),
        ({}, "message Axis .*Mode"),
    ):
        with pytest.raises(FrameError, match=message):
            of.encode("Axis", values)


def test_signed_signals_in_motorola_order_cross_the_bytes_of_a_long_frame(tmp_path: Path) -> None:
    """Of CAN FD, of whose value table one value lies beyond its limits."""
    of = codec(tmp_path, CLUSTER)
    data = bytes([0xFF, 0xD2, 0x71, 0x0F]) + bytes(58) + bytes([0x0F, 0xFF])
    values: dict[str, float | str] = {"Torque": -0.75, "Speed": 100.0, "Gear": "NOT_VALID", "Steering": -0.5}
    assert of.encode("Cluster", values) == Frame(1056, data, is_fd=True)
    found = of.decode(Frame(1056, data, is_fd=True), strict=False)
    assert found.values == pytest.approx(values | {"Gear": 13.0}, rel=1e-9, abs=0.0)
    assert of.choice("Cluster", "Gear", found.values["Gear"]) == "NOT_VALID"
    assert not found.dropped
    with pytest.raises(FrameError, match=r"0x420 .* is a classic frame, expected a CAN FD one"):
        of.decode(Frame(1056, data))
    with pytest.raises(FrameError, match=r"Torque is 512 Nm, expected -512 to 511.75 Nm"):
        of.encode("Cluster", values | {"Torque": 512})
    (tmp_path / "rig.toml").write_text(
        'dbc = "others.dbc"\n[peers.a]\nrequest = 1\nanswer = 2\n[pattern]\n[[printer]]\ndo = "download"\npeer = "a"\n'
        '[[printer]]\ndo = "wait"\nmessage = "Cluster"\nsignal = "Gear"\nexpected = "NOT_VALID"\n'
    )
    assert load(tmp_path / "rig.toml", small_job(3, 3)).needs_fd


def test_file_is_read_as_a_dbc_whatever_its_suffix(tmp_path: Path) -> None:
    """Formats of XML would bring in entities, and conventions that nothing here tests."""
    (tmp_path / "a.kcd").write_text('<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"/>')
    with pytest.raises(FrameError, match="cannot be read as a DBC"):
        Codec(tmp_path / "a.kcd")


def test_other_messages_of_a_file_with_overlapping_signals_are_read_if_that_is_meant(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match=r"cannot be read as a DBC: .*; strict = false reads the messages without"):
        codec(tmp_path, OVERLAPPING + SCALED)
    found = codec(tmp_path, OVERLAPPING + SCALED, strict=False)
    assert read(found, bytes([2, 7, 0, 0])).values["Level"] == 7.0
    with pytest.raises(FrameError, match="of Odd cannot be read, as its signals overlap"):
        found.decode(Frame(100, bytes([0x34, 0x12])), strict=False)


@pytest.mark.parametrize(
    ("gap", "read_as"),
    [(0, 0), (127, 127), (0x80, 127), (0xF0, 127), (0xF1, 0xF1), (0xF9, 0xF9), (0xFA, 127), (0xFF, 127)],
)
def test_reserved_gap_of_a_flow_control_is_the_longest_one(gap: int, read_as: int) -> None:
    assert without_reserved_gap(bytes([0x30, 8, gap, 0xCC])) == bytes([0x30, 8, read_as, 0xCC])
    assert without_reserved_gap(bytes([0x21, 8, gap])) == bytes([0x21, 8, gap])
    assert without_reserved_gap(bytes([0x30, 8])) == bytes([0x30, 8])


def test_signal_without_limits_has_those_of_its_bits(tmp_path: Path) -> None:
    of = codec(tmp_path, UNLIMITED)
    ends = [
        {"Up": 0, "Both": -54.0, "Down": -510, "Shifted": 100},
        {"Up": 255, "Both": 73.5, "Down": 0, "Shifted": 355},
    ]
    frames = [of.encode("Plain", end) for end in ends]
    assert [frame.data.hex() for frame in frames] == ["0080ff00", "ff7f00ff"]
    assert [of.decode(frame).values for frame in frames] == ends
    for name, beyond, limits in (
        ("Up", 256, "256, expected 0 to 255"),
        ("Both", 74.0, "74 V, expected -54 to 73.5 V"),
        ("Both", -54.5, "-54.5 V, expected -54 to 73.5 V"),
        ("Down", 2, "2, expected -510 to 0"),
        ("Shifted", 99, "99, expected 100 to 355"),
    ):
        with pytest.raises(FrameError, match=rf"{name} is {limits}$"):
            of.encode("Plain", ends[0] | {name: beyond})
