"""The wire library of the firmware, compiled for the tests and loaded with ctypes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from inkloop_hardware.protocol.codec import Frame
from support import compiled
from support.benches.node_bench import SANITIZERS, codec
from support.places import C_SOURCES, ROOT

CAN = ROOT / "hardware" / "firmware" / "can"
SOURCES = [CAN / f"{name}.c" for name in ("e2e", "e2e_monitor", "isotp", "slcan")]
WARNINGS = ("-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
TRAPS = ("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error")
ENDS = ("none", "done", "timeout", "sequence", "overflow", "waits", "flow")
REQUEST_ID, ANSWER_ID = 0x640, 0x641


@functools.cache
def wire_library() -> ctypes.CDLL:
    """Undefined behaviour ends it."""
    sources = [*SOURCES, codec() / "inkloop.c", C_SOURCES / "wire_probe.c"]
    flags = ("-std=c11", "-O1", *WARNINGS, *(SANITIZERS or TRAPS), f"-I{CAN}", f"-I{codec()}")
    loaded = compiled.library("wire.so", sources, flags)
    for name in ("probe_sizes", "probe_isotp_received", "probe_slcan_write"):
        loaded[name].restype = ctypes.c_size_t
    for name in ("e2e_check", "isotp_send", "isotp_is_sending", "e2e_monitor_trusts"):
        loaded[name].restype = ctypes.c_bool
    return loaded


def numbers(count: int) -> ctypes.Array[ctypes.c_uint32]:
    return (ctypes.c_uint32 * count)()


@dataclass(frozen=True)
class IsotpState:
    sent: str
    received: str
    received_count: int
    sent_count: int
    dropped: int
    replaced: int
    malformed: int
    unexpected: int
    is_sending: bool


class IsotpEnd:
    """One end of the firmware's ISO-TP; the node's by default."""

    def __init__(
        self, block_size: int = 0, separation: int = 0, *, receive: int = REQUEST_ID, send: int = ANSWER_ID
    ) -> None:
        self.library = wire_library()
        self.memory = ctypes.create_string_buffer(self.library.probe_sizes(0))
        self.library.probe_isotp_init(self.memory, receive, send, block_size, separation)

    def take(self, frame: Frame, now: int) -> bool:
        return bool(
            self.library.probe_isotp_take(
                self.memory, frame.arbitration_id, frame.data, len(frame.data), now & 0xFFFFFFFF
            )
        )

    def tick(self, now: int) -> None:
        self.library.isotp_tick(self.memory, ctypes.c_uint32(now))

    def next(self, now: int) -> Frame | None:
        arbitration_id, data = ctypes.c_uint32(), ctypes.create_string_buffer(8)
        length = self.library.probe_isotp_next(self.memory, now & 0xFFFFFFFF, ctypes.byref(arbitration_id), data)
        return Frame(arbitration_id.value, data.raw[:length]) if length else None

    def send(self, message: bytes) -> bool:
        return bool(self.library.isotp_send(self.memory, message, ctypes.c_size_t(len(message))))

    def receive(self) -> bytes:
        """The last message, which is released; empty if there is none."""
        message = ctypes.create_string_buffer(4095)
        length = self.library.probe_isotp_received(self.memory, message)
        return message.raw[:length]

    @property
    def state(self) -> IsotpState:
        found = numbers(9)
        self.library.probe_isotp_state(self.memory, found)
        sent, received, *counts, is_sending = found
        fields: list[Any] = [ENDS[sent], ENDS[received], *counts, bool(is_sending)]
        return IsotpState(*fields)


@dataclass(frozen=True)
class SlcanFrame:
    arbitration_id: int
    extended: bool
    remote: bool
    length: int
    data: bytes


class SlcanEnd:
    """The adapter's side of the line protocol."""

    def __init__(self, *, opened: bool = True) -> None:
        self.library = wire_library()
        self.memory = ctypes.create_string_buffer(self.library.probe_sizes(1))
        self.library.slcan_init(self.memory)
        if opened:
            self.take(b"O\r")

    def take(self, text: bytes) -> tuple[list[SlcanFrame], bytes]:
        """Frames for the bus, and the answers."""
        frames, answers = [], b""
        found, data, answer = numbers(5), ctypes.create_string_buffer(8), ctypes.create_string_buffer(8)
        for byte in text:
            length = self.library.probe_slcan_take(self.memory, byte, found, data, answer)
            if length < 0:
                continue
            answers += answer.raw[:length]
            if found[0]:
                payload = b"" if found[3] else data.raw[: found[4]]
                frames.append(SlcanFrame(found[1], bool(found[2]), bool(found[3]), found[4], payload))
        return frames, answers

    @property
    def counts(self) -> Sequence[int]:
        """Frames, malformed lines, refused lines."""
        found = numbers(3)
        self.library.probe_slcan_counts(self.memory, found)
        return list(found)

    def write(self, frame: SlcanFrame) -> bytes:
        line = ctypes.create_string_buffer(32)
        data = frame.data.ljust(8, b"\0")
        length = self.library.probe_slcan_write(
            frame.arbitration_id, frame.extended, frame.remote, frame.length, data, line
        )
        return line.raw[:length]
