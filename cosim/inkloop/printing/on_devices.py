"""A print on devices: their messages on the screen and in `bench.log`, and whether the emulator listens."""

from __future__ import annotations

import logging
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from inkloop.component import DEVICE_LOGGER
from inkloop.components import devices
from inkloop.components.catalog import MAP_FOLDER
from inkloop.errors import ComponentError
from inkloop.files import open_own, reason_of
from inkloop.report import shown
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario

LOG_FILE = "bench.log"


class _OnScreen(logging.Handler):
    def __init__(self, console: Terminal) -> None:
        super().__init__(logging.INFO if console.verbose else logging.WARNING)
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        style = "red" if record.levelno >= logging.WARNING else "dim"
        self._console.sentence(f"  {record.getMessage()}", style)


class _InFile(logging.FileHandler):
    """Appends to a file; where that fails, as on a full disk, one message says so and the print continues."""

    def __init__(self, path: Path, console: Terminal) -> None:
        super().__init__(path, delay=True, encoding="utf-8")
        self._console, self._has_failed = console, False

    def _open(self) -> Any:
        return open_own(self.baseFilename, self.mode, encoding=self.encoding)

    def emit(self, record: logging.LogRecord) -> None:
        """Open the file with the first record, which the handler of the standard library does unguarded."""
        try:
            super().emit(record)
        except OSError:
            self.handleError(record)

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record, with control characters of what devices send as escapes."""
        return shown(super().format(record))

    def handleError(self, record: logging.LogRecord) -> None:
        """Report the first error."""
        error = sys.exc_info()[1]
        if not self._has_failed and isinstance(error, OSError):
            lost = f"{self.baseFilename} cannot be written: {reason_of(error)}; its messages are shown here only"
            self._console.sentence(f"  {lost}", "red")
        self._has_failed = True

    def close(self) -> None:
        """Close the file; records that do not fit on the disk are lost, as reported."""
        with suppress(OSError):
            super().close()


@contextmanager
def live_words(console: Terminal, folder: Path | None) -> Iterator[None]:
    """Within the block warnings of devices are shown, with --verbose all messages; the log of the folder gets all.

    The folder has to exist when the first message comes.
    """
    handlers: list[logging.Handler] = [_OnScreen(console)]
    if folder is not None:
        handlers.append(_InFile(folder / LOG_FILE, console))
        handlers[-1].setFormatter(
            logging.Formatter("%(asctime)s.%(msecs)03d %(levelname)s %(message)s", "%Y-%m-%d %H:%M:%S")
        )
    logger = logging.getLogger(DEVICE_LOGGER)
    level = logger.level
    logger.setLevel(logging.INFO)
    for handler in handlers:
        logger.addHandler(handler)
    try:
        yield
    finally:
        logger.setLevel(level)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()


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


def log_devices(scenario: Scenario, console: Terminal, folder: Path) -> AbstractContextManager[None]:
    """Shows messages of devices, if there are any. Raises ComponentError if their emulated bus is not running."""
    kinds = {table.kind for table in scenario.tables.components.values()}
    if not kinds.isdisjoint(devices.KINDS):
        check_listening(scenario)
    elif MAP_FOLDER not in kinds:
        return nullcontext()
    return live_words(console, folder)
