"""A rig that is not ours, as a process: a PLC that speaks frames, a head controller and a scanner that speak services.

    python foreign_rig.py CHANNEL [wide] [log=FILE]

It notes in FILE each pattern, start and end of a layer and scan, with the number of the layer. It knows nothing of
inkloop: stock python-can and can-isotp, a DBC of its own, patterns and maps in forms of its own. The wide one has ids
of 29 bits and speaks CAN FD only, with bit-rate switch.
"""

from __future__ import annotations

import re
import struct
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import isotp
import numpy as np

NX, NY = 6, 5
DROPLET_UM = 10.0
_PAGE = (Path(__file__).parents[3] / "docs/how-to/bind-your-own-dbc.md").read_text(encoding="utf-8")
DBC, MAPPING = (re.findall(rf"```{kind}\n(.*?)```", _PAGE, re.DOTALL)[0] for kind in ("dbc", "toml"))
"""Those of the page, so that the page is tested."""
SCENARIO = """
title = "A rig of one's own"

[grid]
nx = 6
ny = 5

[part]
shape = "cuboid"
size_x_um = 900.0
size_y_um = 600.0
height_um = 20.0

[bench]
interface = "slcan"
channel = "CHANNEL"
traffic_log = ""

[run]
layers_max = 2

[components.controller]
kind = "OpenLoop"
layers = 2

[components.rig]
kind = "hardware.mapped"
mapping = "rig.toml"
"""
LONG = 0x18DA0000
"""Added to the ids of the page by the wide rig."""


def wide_dbc() -> str:
    """The DBC of the wide rig: 29-bit ids, and a state of 12 bytes."""
    text = DBC.replace("PlcState: 8", "PlcState: 12").replace(" SG_ State : 0|3", " SG_ State : 88|3")
    formats = ",".join(f'"{name}"' for name in ("StandardCAN", "ExtendedCAN", *"23456789abcd", "e", "ExtendedCAN_FD"))
    text += f'BA_DEF_ BO_  "VFrameFormat" ENUM  {formats};\nBA_DEF_DEF_  "VFrameFormat" "StandardCAN";\n'
    for number in (528, 544, 1952, 1960):
        long = 1 << 31 | LONG | number
        text = re.sub(rf"(BO_|VAL_) {number} ", rf"\1 {long} ", text) + f'BA_ "VFrameFormat" BO_ {long} 15;\n'
    return text


def wide_mapping() -> str:
    """The mapping of the wide rig."""
    text = MAPPING.replace('answer = "HeadAnswer"', 'answer = "HeadAnswer"\nfd = true')
    return text.replace("0x7B0", f"0x{LONG | 0x7B0:X}").replace("0x7B8", f"0x{LONG | 0x7B8:X}\nfd = true")


@contextmanager
def running(channel: str, *words: str) -> Iterator[None]:
    """The rig on a bus, in a process of its own; words: of its command line."""
    command = [sys.executable, __file__, channel, *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n", process.communicate()[1]
        yield
    finally:
        process.kill()
        process.communicate()


class Log:
    """Log of the rig, a line for each thing done: its name, and the number of the layer."""

    def __init__(self, path: str | None) -> None:
        self._path = path

    def note(self, what: str, layer: int) -> None:
        if self._path is not None:
            with Path(self._path).open("a", encoding="utf-8") as file:
                file.write(f"{what} {layer}\n")


class Server:
    """The UDS services of one address; subclasses define what they do."""

    def __init__(
        self, bus: can.BusABC, notifier: can.Notifier, request: int, answer: int, wide: bool, log: Log
    ) -> None:
        self.log = log
        mode = isotp.AddressingMode.Normal_29bits if wide else isotp.AddressingMode.Normal_11bits
        address = isotp.Address(mode, txid=LONG * wide + answer, rxid=LONG * wide + request)
        params = {"tx_padding": 0} | ({"can_fd": True, "tx_data_length": 64, "bitrate_switch": True} if wide else {})
        self.stack = isotp.NotifierBasedCanStack(bus, notifier, address=address, params=params)
        self.stack.start()
        self.blob = b""
        self.size = 0
        self.counter = 0

    def serve(self) -> None:
        while True:
            request = self.stack.recv(block=True, timeout=1.0)
            if request:
                self.stack.send(self.answer(bytes(request)))

    def answer(self, request: bytes) -> bytes:
        raise NotImplementedError


class Head(Server):
    """Takes a pattern in blocks of 22 bytes."""

    pattern = np.zeros((NX, NY), np.int64)
    layer = 0

    def answer(self, request: bytes) -> bytes:
        if request[0] == 0x34:
            self.layer, self.size = struct.unpack(">IH", request[3:9])
            self.blob, self.counter = b"", 0
            return bytes([0x74, 0x20]) + (24).to_bytes(2, "big")
        if request[0] == 0x36 and request[1] == (self.counter + 1) % 256:
            self.counter = request[1]
            self.blob += request[2:]
            return bytes([0x76, request[1]])
        line = (2 * NX + 7) // 8
        if request[0] == 0x37 and len(self.blob) == self.size == 3 + line * NY:
            if self.blob[:3] != b"\xa5" + self.layer.to_bytes(2, "big"):
                return b"\x7f\x37\x31"
            lines = np.frombuffer(self.blob[3:], np.uint8).reshape(NY, line)
            bits = np.unpackbits(lines, axis=1, bitorder="little")[:, : 2 * NX].reshape(NY, NX, 2)
            self.log.note("pattern", self.layer)
            self.pattern = (bits[..., 0] + 2 * bits[..., 1].astype(np.int64)).T
            return b"\x77"
        return bytes([0x7F, request[0], 0x31])


class Scanner(Server):
    """Scans when asked, which takes a moment; cell (2, 1) is not seen."""

    surface_um = np.zeros((NX, NY))
    layer = 0xFFFF

    def answer(self, request: bytes) -> bytes:
        if request[:4] == b"\x31\x01\x03\x10":
            self.stack.send(b"\x7f\x31\x78")
            time.sleep(0.1)
            self.layer = int.from_bytes(request[4:6], "big")
            self.log.note("scan", self.layer)
            seen = self.surface_um.astype("<f4")
            seen[2, 1] = -999.0
            self.blob = b"HM" + bytes([NX, NY]) + seen.T.tobytes()
            return b"\x71\x01\x03\x10\x01"
        if request == b"\x22\x01\x07":
            return b"\x62\x01\x07\xee" + self.layer.to_bytes(2, "big")
        if request == b"\x35\x00\x21\x20" + len(self.blob).to_bytes(2, "big"):
            self.counter = 0
            return b"\x75\x10\x40"
        if request[0] == 0x36:
            at = self.counter * 62
            self.counter += 1
            return bytes([0x76, request[1]]) + self.blob[at : at + 62]
        if request[0] == 0x37:
            return b"\x77" + zlib.crc32(self.blob).to_bytes(4, "big")
        return bytes([0x7F, request[0], 0x11])


class Plc(can.Listener):
    """Jets what the head holds on request, and sends its state every 20 ms; told: layer of which it has sent BUSY."""

    def __init__(self, bus: can.BusABC, head: Head, scanner: Scanner, wide: bool) -> None:
        self.bus, self.head, self.scanner, self.wide = bus, head, scanner, wide
        self.done, self.asked, self.told, self.busy_until = 0, 0, 0, 0.0
        self.failed = False

    def on_message_received(self, message: can.Message) -> None:
        if (message.arbitration_id, message.is_extended_id) != (LONG * self.wide + 0x210, self.wide):
            return
        if (message.is_fd, message.bitrate_switch) != (self.wide, self.wide):
            return
        self.failed = message.data[3] != 75  # a lamp at another power than 37.5 % is none of its own
        if message.data[2] & 1 and not self.failed:
            self.asked, self.busy_until = int.from_bytes(message.data[:2], "little"), time.monotonic() + 0.1
            self.done = self.asked - 1
            self.head.log.note("start", self.asked)

    def run(self) -> None:
        while True:
            now, asked = time.monotonic(), self.asked
            if self.told == asked > self.done and now > self.busy_until and self.head.layer == asked:
                self.scanner.surface_um = self.scanner.surface_um + DROPLET_UM * self.head.pattern
                self.done = asked
                self.head.log.note("done", self.done)
            state = 3 if self.failed else 1 if asked > self.done else 2
            self.told = asked if state == 1 else self.told
            data = struct.pack("<BHHhx", 0 if self.wide else state, self.done, 1250, 215)
            data += bytes([0, 0, 0, state]) if self.wide else b""
            frame = can.Message(arbitration_id=LONG * self.wide + 0x220, is_extended_id=self.wide, data=data)
            frame.is_fd = frame.bitrate_switch = self.wide
            self.bus.send(frame)
            time.sleep(0.02)


def main(channel: str, wide: bool, log: Log) -> None:
    is_line = "/" in channel
    bus = can.Bus(channel, "slcan", sleep_after_open=0.0) if is_line else can.Bus(channel, "socketcan", fd=wide)
    with bus:
        notifier = can.Notifier(bus, [], timeout=0.05)
        head, scanner = Head(bus, notifier, 0x7A0, 0x7A8, wide, log), Scanner(bus, notifier, 0x7B0, 0x7B8, wide, log)
        plc = Plc(bus, head, scanner, wide)
        notifier.add_listener(plc)
        for server in (head, scanner):
            threading.Thread(target=server.serve, daemon=True).start()
        print("ready", flush=True)
        plc.run()


if __name__ == "__main__":
    logs = [word.removeprefix("log=") for word in sys.argv[2:] if word.startswith("log=")]
    main(sys.argv[1], "wide" in sys.argv, Log(logs[0] if logs else None))
