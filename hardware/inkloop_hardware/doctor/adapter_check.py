"""Check of the adapter before anything is sent: its interface, driver, port and permissions.

The back-ends of python-can fail in different ways: NotImplementedError without a module, NameError or OSError without a
driver, an error of the port if that is missing. Here each gets its own advice.
"""

from __future__ import annotations

import errno
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

import can
from can.interfaces import VALID_INTERFACES
from can.util import load_config

from inkloop_hardware.bus.adapter import NETWORK, Adapter, has_carrier
from inkloop_hardware.bus.heartbeat import NONE
from inkloop_hardware.bus.settings import ON_SERIAL_PORTS, BusSettings, interface_of
from inkloop_hardware.doctor.findings import Finding
from inkloop_hardware.errors import BusError

DRIVER_MISSING = (ImportError, NameError, NotImplementedError)


def configured(settings: BusSettings) -> BusSettings:
    """The settings with what python-can's own configuration adds to them."""
    try:
        found = load_config(config=settings.arguments())
    except NotImplementedError:
        return replace(settings, interface=interface_of(settings))
    channel, bitrate = (found.get(name) for name in ("channel", "bitrate"))
    return replace(
        settings, interface=found.get("interface"), channel=None if channel is None else str(channel), bitrate=bitrate
    )


def before_opening(settings: BusSettings, network: Path = NETWORK) -> Iterator[Finding]:
    """Check an adapter without opening it. settings: see `configured`; network: folder of the network interfaces."""
    name, channel = settings.interface, settings.channel
    if name is None:
        yield Finding.error(
            "interface",
            "no interface is named, and python-can's own configuration names none",
            "set bench.interface and bench.channel, or CAN_INTERFACE and CAN_CHANNEL, or write ~/.canrc",
        )
        return
    if name not in VALID_INTERFACES:
        near = get_close_matches(name, VALID_INTERFACES, 1)
        advice = f"did you mean {near[0]!r}?" if near else f"it knows {', '.join(sorted(VALID_INTERFACES))}"
        yield Finding.error("interface", f"python-can knows no interface {name!r}", advice)
        return
    yield Finding.ok("interface", f"{name}, of python-can {can.__version__}")
    if channel is None:
        yield Finding.error("adapter", f"no channel is named for {name}", "set bench.channel, " + _example(name))
    elif name == "socketcan":
        yield from _network_interface(str(channel), network)
    elif name in ON_SERIAL_PORTS and str(channel).startswith("/"):
        yield from _serial_port(Path(str(channel)))
    if name == "slcan" and settings.bitrate is None and not _is_network(channel):
        yield Finding.warning("adapter", "no bit rate is set, the adapter keeps its own", "set bench.bitrate, 500000")


def heartbeat_priority() -> Finding:
    """Scheduling priority granted to a bus process of this user, tried in a process of its own."""
    command = [sys.executable, "-P", "-m", "inkloop_hardware.bus.heartbeat"]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    if found and not found.startswith(NONE):
        return Finding.ok("priority", f"the heartbeat has {found}")
    return Finding.warning(
        "priority",
        f"the heartbeat has {found or NONE}: on a busy machine it may come late, and the nodes go off",
        "print on a machine that does nothing else, or give this user `rtprio 1` in /etc/security/limits.conf",
    )


def opened(settings: BusSettings) -> tuple[Adapter | None, Finding]:
    """Open the adapter; None with an error if it cannot be opened."""
    try:
        adapter = Adapter(settings)
    except BusError as error:
        return None, Finding.error(
            "adapter", f"{settings} cannot be opened: {error.__cause__}", _advice(settings, error)
        )
    return adapter, Finding.ok("adapter", f"{settings} is open")


def _network_interface(channel: str, network: Path) -> Iterator[Finding]:
    if not (network / channel).exists():
        present = sorted(path.name for path in network.glob("*can*")) if network.exists() else []
        found = f"it has {', '.join(present)}" if present else "load its driver (`modprobe gs_usb` ...), see `ip link`"
        yield Finding.error(
            "adapter", f"this machine has no network interface {channel!r}", f"plug the adapter in; {found}"
        )
    elif not has_carrier(channel, network):
        yield Finding.error(
            "adapter",
            f"the network interface {channel} has no carrier: its controller is bus-off, or its other end is down",
            f"check cables, termination and bit rate, then `sudo ip link set {channel} type can restart`",
        )
    elif (network / channel / "operstate").read_text(encoding="ascii").strip() == "down":
        command = f"sudo ip link set {channel} up type can bitrate 500000 restart-ms 0"
        yield Finding.error("adapter", f"the network interface {channel} is down", f"`{command}`")


def _serial_port(port: Path) -> Iterator[Finding]:
    if not port.exists():
        ports = serial_ports()
        found = f"the serial ports of this machine: {', '.join(ports)}" if ports else "this machine has no serial port"
        yield Finding.error("adapter", f"there is no {port}", f"plug the adapter in; {found}")
    elif not os.access(port, os.R_OK | os.W_OK):
        yield Finding.error("adapter", f"{port} may not be read and written by this user", f"`{_group_command(port)}`")


def serial_ports() -> Sequence[str]:
    """Serial ports with their devices, as far as pyserial knows them."""
    try:
        found = importlib.import_module("serial.tools.list_ports").comports()
    except ImportError:  # pyserial is an extra of python-can
        return []
    return [f"{port.device} ({port.description})" for port in found if port.hwid != "n/a"]


def _is_network(channel: str | int | None) -> bool:
    """Whether the other end of a channel is a program, which has no bit rate."""
    return str(channel).startswith("socket://")


def _group_command(port: Path) -> str:
    return f"sudo usermod -a -G {port.group()} $USER` and a new login, or `sudo chmod a+rw {port}"


def _advice(settings: BusSettings, error: BusError) -> str:
    cause = error.__cause__
    local = _is_network(settings.channel)
    text, number = str(cause), getattr(cause, "errno", None)
    if isinstance(cause, DRIVER_MISSING) or "library" in text or number == errno.EAFNOSUPPORT:
        return (
            "install the driver of the adapter's maker, and the package that python-can names for it "
            f"(`pip install 'python-can[{settings.interface}]'`); it may not exist for this system"
        )
    if local:
        return "nothing listens there: is it the right port, and does `inkloop bench emulate` run?"
    if number in (errno.EBUSY, errno.EAGAIN) or "busy" in text or "lock" in text:
        return "another program has it open: end that one"
    if number in (errno.EACCES, errno.EPERM) or "ermission" in text:
        return "give this user access to it (group dialout for serial ports)"
    return "is the adapter plugged in, is this its channel, is it up, and does no other program have it open?"


def _example(name: str) -> str:
    return {"socketcan": '"can0"', "slcan": '"/dev/ttyACM0"', "pcan": '"PCAN_USBBUS1"'}.get(name, "see its page")
