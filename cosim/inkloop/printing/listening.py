"""Check that the emulator listens at the scenario's channel before a print begins."""

from __future__ import annotations

import re
import socket

from inkloop.errors import ComponentError
from inkloop.scenario.file import Scenario

_LOCAL = re.compile(r"socket://127\.0\.0\.1:(\d+)")


def local_port(channel: str | int | None) -> int | None:
    """Port of a channel on this machine that the emulator may listen at; None for any other channel."""
    found = _LOCAL.fullmatch(str(channel or ""))
    return int(found[1]) if found else None


def check_listening(scenario: Scenario) -> None:
    """Raises ComponentError where the scenario's channel is a port of this machine without a listener."""
    channel = scenario.tables.bench.channel
    port = local_port(channel)
    if port is None:
        return
    try:
        socket.create_connection(("127.0.0.1", port), timeout=2.0).close()
    except OSError as error:
        raise ComponentError(
            f"nothing listens at {channel}, the channel of [bench] ({error.strerror or error}); "
            f"`inkloop bench emulate {scenario.source}` in another terminal starts the emulator there"
        ) from error
