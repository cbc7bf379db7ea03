"""The CAN adapter of a bench: opens it, reads frames in bulk, resends frames that its full buffer refuses.

`Reopening` has the rules by which a disconnected one is opened again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import can
from can.util import load_config

from inkloop_hardware.bus.fmu_bus import INTERFACE as FMU
from inkloop_hardware.bus.fmu_bus import FmuBus
from inkloop_hardware.bus.settings import BusSettings, interface_of
from inkloop_hardware.bus.slcan_bus import BulkSlcanBus
from inkloop_hardware.errors import BusError, BusOff
from inkloop_hardware.protocol.codec import EXTENDED, Frame


def message_of(frame: Frame, *, bit_rate_switch: bool = False) -> can.Message:
    """A frame that is to be sent; bit_rate_switch: the data of one of CAN FD travel at the data bit rate."""
    return can.Message(
        arbitration_id=frame.arbitration_id & ~EXTENDED,
        is_extended_id=bool(frame.arbitration_id & EXTENDED),
        is_fd=frame.is_fd,
        bitrate_switch=frame.is_fd and bit_rate_switch,
        data=frame.data,
        is_rx=False,
    )


def data_frame(message: can.Message) -> Frame | None:
    """The frame of a message, None for an error or remote frame."""
    if message.is_error_frame or message.is_remote_frame:
        return None
    identifier = message.arbitration_id | EXTENDED * message.is_extended_id
    return Frame(identifier, bytes(message.data), message.is_fd)


PATIENCE = 1.0
"""Seconds for a frame to leave: a full transmit queue (ENOBUFS) empties in milliseconds."""
SEND_PAUSE = 0.001
AT_ONCE = 512
"""Frames taken in one turn."""
BUS_OFF = 0x40
"""Class of SocketCAN's error frames."""
NETWORK = Path("/sys/class/net")
"""Folder of the network interfaces of a Linux machine."""


class Adapter:
    """A bus of python-can.

    bus: one that is open already; None: that of the settings, BusError if it cannot be opened.
    repeated: how often a frame had to be sent again; errors: error frames seen. now, sleep: the clock of the bus, the
    simulated one of an FMU. BusOff when it has left the bus.
    """

    def __init__(
        self,
        settings: BusSettings,
        bus: can.BusABC | None = None,
        *,
        monotonic: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.settings = settings
        self.repeated = 0
        self.errors = 0
        self.is_gone = False
        self.now, self.sleep, self._wall = monotonic, sleep, time.time
        try:
            self.bus = bus or _open(settings)
        except Exception as error:  # drivers of many makers: NotImplementedError, NameError, OSError, ...
            raise BusError(f"{settings} cannot be opened: {error}. {_advice(settings)}") from error
        if isinstance(self.bus, FmuBus):
            self.now, self.sleep, self._wall = self.bus.now, self.bus.sleep, self.bus.now
        self._interface: str = getattr(self.bus, "channel", "") if ".socketcan" in type(self.bus).__module__ else ""

    def receive(self, wait_s: float) -> list[can.Message]:
        """Frames received, at least one unless `wait_s` passed; BusError when the adapter is disconnected."""
        found: list[can.Message] = []
        try:
            message = self.bus.recv(wait_s)
            while message is not None:
                found.append(message)
                message = self.bus.recv(0) if len(found) < AT_ONCE else None
        except (can.CanError, OSError) as error:
            self.is_gone = True
            raise BusError(f"{self.settings} cannot be read any more: {error}. Was it unplugged or ended?") from error
        if isinstance(self.bus, BulkSlcanBus) and (since := self.bus.bus_off_since) is not None:
            raise BusOff(
                f"{self.settings} refuses every frame and receives none: bus-off, or no node acknowledges. Check "
                "cables, termination, bit rate and the power of the nodes.",
                since,
            )
        for message in found:
            if message.is_error_frame:
                self._take_error(message)
        if not found and self._interface and not has_carrier(self._interface):
            raise self._bus_off("has no carrier: its controller is bus-off, or the interface at its other end is down")
        return found

    def send(self, frame: Frame) -> can.Message:
        """Send a frame and return it as it was sent; BusError if the adapter does not take it within PATIENCE."""
        message = message_of(frame, bit_rate_switch=self.settings.bit_rate_switch)
        until, pause = self.now() + PATIENCE, SEND_PAUSE
        while True:
            message.timestamp = self._wall()
            try:
                self.bus.send(message, PATIENCE)
                return message
            except (can.CanError, OSError) as error:
                if self.is_gone or self.now() + pause > until:
                    raise BusError(
                        f"{self.settings} accepts no frame for {PATIENCE:g} s ({error}). Is it plugged in, is the bus "
                        "terminated, and does any other node on it acknowledge frames?"
                    ) from error
            self.repeated += 1
            self.sleep(pause)
            pause *= 2

    def complaints(self) -> dict[str, int]:
        """Counts of problems that were tolerated, by description."""
        counts = {"frames sent again": self.repeated, "error frames on the bus": self.errors}
        if isinstance(self.bus, BulkSlcanBus):
            counts |= {
                "malformed lines of the adapter": self.bus.malformed,
                "commands that the adapter refused": self.bus.refused,
            }
        return counts

    def close(self) -> None:
        """Release the adapter; one that is disconnected is closed already."""
        try:
            self.bus.shutdown()
        except (can.CanError, OSError):
            self.bus._is_shutdown = True  # keeps its destructor from complaining

    def _take_error(self, message: can.Message) -> None:
        self.errors += 1
        if message.arbitration_id & BUS_OFF and self._interface:
            raise self._bus_off("is bus-off: too many errors")

    def _bus_off(self, what: str) -> BusOff:
        return BusOff(
            f"{self.settings} {what}. Check cables, termination and bit rate, then "
            f"`sudo ip link set {self._interface} type can restart`, or down and up.",
            time.monotonic(),
        )


def has_carrier(interface: str, network: Path = NETWORK) -> bool:
    """Whether frames of a network interface are sent; an interface that is bus-off accepts frames without an error and
    drops them.

    True for one that is down: it has no state, and reading and writing fail by themselves.
    """
    with suppress(OSError):
        return (network / interface / "carrier").read_text(encoding="ascii").strip() != "0"
    return True


def _open(settings: BusSettings) -> can.BusABC:
    arguments = settings.arguments()
    name = interface_of(settings)
    if name is None:
        raise ValueError("it names none")
    if name == FMU:
        return can.Bus(**{"real_time": False} | arguments)
    if name != "slcan":
        return can.Bus(**arguments)
    found = {name: value for name, value in load_config(config=arguments).items() if value is not None}
    del found["interface"]
    if "channel" not in found:
        raise ValueError("an slcan adapter needs a channel, such as /dev/ttyACM0 or socket://127.0.0.1:29536")
    return BulkSlcanBus(str(found.pop("channel")), **found)


def _advice(settings: BusSettings) -> str:
    if str(settings.channel).startswith("socket://"):
        return "Is a program listening there? `inkloop bench emulate` starts the emulator"
    if interface_of(settings) == FMU:
        return "`inkloop export bench` writes the FMU; bench.channel names it from the scenario's folder"
    if settings.interface is None:
        known = "CAN_INTERFACE and CAN_CHANNEL, or ~/.canrc"
        return f"Set interface and channel of [bench] in the scenario, or configure python-can ({known})"
    return "Is the adapter plugged in, its driver installed, its interface up, and may this user open it?"


FIRST_PAUSE, LONGEST_PAUSE = 0.1, 2.0
BUS_OFF_PAUSE = 1.0
"""Seconds of silence after bus-off: 128 times 11 recessive bits are 3 ms at 500 kbit/s, the rest is for the cause."""
STABLE_AFTER = 10.0
"""Seconds after which an adapter that was opened again counts as stable."""
PROOF = 0.3
"""Seconds in which an adapter that was opened again must not fail: some open without an error and close at once."""


@dataclass
class Reopening:
    """Pauses between tries. limit_s: seconds of tries after an unplugged adapter; bus_off: it was bus-off before."""

    limit_s: float
    bus_off: bool = False
    _pause: float = FIRST_PAUSE
    _waited: float = 0.0
    _opened_at: float = -math.inf

    def opened(self, now: float) -> None:
        """Note the second at which it was opened again."""
        self._opened_at = now

    def pauses(self, error: BusError, lit: bool, now: float) -> Iterator[float]:
        """Seconds to wait before each try to open it; BusError when no try is left.

        lit: the lamp was enabled. An adapter that fails soon after it was opened again gets no additional tries. One
        that is bus-off is opened again once, and never when the lamp was on: a person must check the bench first.
        """
        if isinstance(error, BusOff):
            yield from self._after_bus_off(error, lit)
            return
        if now - self._opened_at > STABLE_AFTER:
            self._pause, self._waited = FIRST_PAUSE, 0.0
        while self._waited < self.limit_s:
            pause = self._pause
            self._waited += pause
            self._pause = min(2 * pause, LONGEST_PAUSE)
            yield pause
        raise BusError(f"{error} It could not be opened again within {self._waited:.0f} s")

    def _after_bus_off(self, error: BusError, lit: bool) -> Iterator[float]:
        if lit:
            raise BusError(
                f"{error} The lamp was enabled, so it is not opened again automatically: check the bench first"
            )
        if self.bus_off:
            raise BusError(f"{error} It was opened again once already")
        self.bus_off = True
        yield BUS_OFF_PAUSE
        raise BusError(f"{error} It could not be opened again")
