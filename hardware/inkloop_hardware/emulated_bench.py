"""The emulator as a process: four nodes with the firmware, and behind them a printer made of the FMUs' kernels.

To the components it is a bus like any other.
"""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

import inkloop_hardware
from inkloop.component import FloatMap
from inkloop.files import temporary_folder
from inkloop_hardware.errors import BusError

PROGRAM = "inkloop_bench_nodes"
SURFACE_FILE = "surface.bin"
_SURFACE_MAGIC = b"INKSURF1"


class EmulatedBench:
    """A running emulator, from its start to `close`, at the latest to the end of this process.

    channel: for the bus settings; parameters: options in SI, see docs/reference/node-services.md; port: 0 takes a free
    one; terminal: a pseudo-terminal in place of a port; folder: keeps journals and surface for the next start;
    surface: (nx, ny) [m] to print on, flat if None, ignored if the folder holds one; faults: on request, see
    docs/reference/bench-faults.md. Raises BusError.
    """

    def __init__(
        self,
        parameters: Mapping[str, float],
        *,
        port: int = 0,
        terminal: bool = False,
        folder: Path | None = None,
        surface: FloatMap | None = None,
        faults: Sequence[str] = (),
    ) -> None:
        self._own_folder = ExitStack()
        place = folder
        if folder is None and surface is not None:
            place = self._own_folder.enter_context(temporary_folder("bench"))
        if place:
            place.mkdir(parents=True, exist_ok=True)
            if surface is not None and not (place / SURFACE_FILE).exists():
                _write_surface(place / SURFACE_FILE, surface)
        arguments = ["--pty"] if terminal else ["--port", str(port)]
        arguments += ["--folder", str(place)] if place else []
        arguments += [argument for fault in faults for argument in ("--fault", fault)]
        arguments += [f"{name}={value:.17g}" for name, value in parameters.items()]
        # its standard input is a pipe of this process: the emulator ends with this process, however that ends
        self._process = subprocess.Popen(
            [program(), "--until-stdin-closes", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self.channel = self._process.stdout.readline().strip()
        if not self.channel:
            raise BusError(f"the emulator did not start: {self._last_message()}")

    @property
    def process_id(self) -> int:
        """Of the emulator."""
        return self._process.pid

    def wait(self) -> int:
        """Wait until it ends by itself; its exit code."""
        return self._process.wait()

    def kill(self) -> None:
        """End it as a power failure would."""
        self._process.kill()
        self.close()

    def close(self) -> None:
        """End it; a second time does nothing."""
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()
        self._process.wait()
        self._own_folder.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _last_message(self) -> str:
        assert self._process.stderr is not None
        message = self._process.stderr.read().strip().removeprefix(f"{PROGRAM}: ")
        self.close()
        if "in use" in message:
            message += "; a bench runs there already, end it or take another port"
        return message or f"it ended with exit code {self._process.returncode}"


def program() -> Path:
    """The program of the nodes in the folder of this package. Raises BusError if it was not built."""
    for folder in map(Path, inkloop_hardware.__path__):
        for name in (PROGRAM, f"{PROGRAM}.exe"):
            if (folder / name).is_file():
                return folder / name
    raise BusError(
        f"{PROGRAM} is not installed: the emulator is built on Linux and macOS only; install inkloop there again, "
        "or run the emulator on such a machine and set its channel"
    )


def _write_surface(path: Path, surface: FloatMap) -> None:
    """The surface as the nodes keep it: magic, nx, ny, scans made, heights [m]; the byte order of the machine."""
    head = struct.pack("=8s3i", _SURFACE_MAGIC, *surface.shape, 0)
    path.write_bytes(head + np.ascontiguousarray(surface, np.float64).tobytes())
