"""A co-simulation FMU, FMI 2 or FMI 3, as a component of the loop.

Values go from NumPy arrays to the FMU and back by pointer; no list of Python numbers is made.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import os
import zipfile
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from inkloop.component import Port, Values
from inkloop.errors import ComponentError, FmuError, nearest
from inkloop.files import is_full, reason_of, regular, temporary_folder
from inkloop.fmu.bus_terminals import COUNTDOWN, Events
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.reading import UNREADABLE, describe
from inkloop.limits import unpacked_error
from inkloop.units import NS_PER_S

if TYPE_CHECKING:
    from inkloop.fmu.binding import Binding


_UNUSED = ("documentation", "sources", "terminalsAndIcons")
"""Folders of an archive that an FMU cannot need while it runs."""


def platform_error(description: FmuDescription) -> str | None:
    """The reason why this machine cannot run an FMU: it has no binary for the platform."""
    import fmpy

    needed, held = (
        fmpy.platform if description.fmi == 2 else fmpy.platform_tuple,
        ", ".join(description.platforms) or "none",
    )
    if needed in description.platforms:
        return None
    return f"holds binaries for {held}, this machine needs {needed}; export or compile it for that"


def archive_error(path: Path) -> str | None:
    """The reason why an FMU cannot be unpacked: it is damaged, or too large."""
    try:
        return _archive_error(path, regular(path).stat().st_mtime_ns)
    except OSError as error:
        return f"cannot be read: {reason_of(error)}"


@lru_cache(maxsize=32)
def _archive_error(path: Path, changed_ns: int) -> str | None:
    try:
        with zipfile.ZipFile(path) as archive:
            if reason := unpacked_error(archive):
                return reason
            bad = archive.testzip()
    except UNREADABLE as error:
        return f"cannot be unpacked, it is damaged: {error}"
    return None if bad is None else f"cannot be unpacked, it is damaged: bad CRC-32 of {bad}"


class FmuComponent:
    """A co-simulation FMU behind the `Component` protocol.

    `name` is that of the instance, by default the model's. `parameters` are in the units of the FMU by its names, an
    array for an array, and include structural switches; `structural` resizes FMI 3 arrays and is checked against the
    grid of an FMU whose size is fixed. Both are checked here; the binary is started by `initialize`. Outputs are new
    arrays at every step, so a caller may keep them. Raises FmuError, later ComponentError.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        name: str = "",
        parameters: Mapping[str, object] | None = None,
        structural: Mapping[str, int] | None = None,
    ) -> None:
        self.description = describe(path)
        self._name = name or self.description.name
        self._sizes = self.description.sizes(structural or {})
        checked = dict(self._checked(parameters or {}))
        switches = {n: value for n, value in checked.items() if self.description.variables[n].is_structural}
        self._structural = self._changed_sizes() | switches
        self._parameters = {n: value for n, value in checked.items() if n not in switches}
        self._inputs = self.description.ports("input", self._sizes)
        self._input_names = {port.name for port in self._inputs}
        self._outputs = self.description.ports("output", self._sizes)
        self._binding: Binding | None = None
        self._events: Events | None = None
        self._sent: dict[str, bytes] = {}
        self._now = 0.0
        self._cleanup = contextlib.ExitStack()
        self.sha256 = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        self._folder = self._extract(Path(path))

    @property
    def inputs(self) -> tuple[Port, ...]:
        """Inputs in the order of the description."""
        return self._inputs

    @property
    def outputs(self) -> tuple[Port, ...]:
        """Outputs in the order of the description."""
        return self._outputs

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Start the binary, hand it sizes, parameters and inputs; outputs at `time_ns`."""
        binding = self._binding = self._start()
        structural, parameters = self._structural, self._parameters
        if structural:
            binding.configure([self.description.variables[name].port({}) for name in structural], structural)
        texts = {name: str(value) for name, value in parameters.items() if value.dtype.kind == "U"}
        numbers = [self.description.variables[name].port(self._sizes) for name in parameters if name not in texts]
        binding.set(numbers, parameters)
        binding.set_texts(texts)
        binding.enter_initialization(time_ns / NS_PER_S)
        self._set(binding, inputs)
        binding.exit_initialization()
        self._cleanup.callback(binding.terminate)
        self._now = time_ns / NS_PER_S
        if self.description.needs_events:
            self._events = Events(binding.call, self.description.buses)
            self._handle({})
        return binding.get(self._outputs)

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Advance by one communication step."""
        self.advance(time_ns, step_ns, inputs)
        return self._running().get(self._outputs)

    def advance(self, time_ns: int, step_ns: int, inputs: Values) -> None:
        """One communication step, without reading the outputs."""
        binding = self._running()
        self._set(binding, inputs)
        is_event = binding.do_step(time_ns / NS_PER_S, step_ns / NS_PER_S)
        self._now = (time_ns + step_ns) / NS_PER_S
        if self._events and (is_event or self._events.is_due(self._now)):
            self._handle({})

    def exchange(self, received: Mapping[str, bytes]) -> dict[str, bytes]:
        """Give operations to buses, by name, at the present communication point; what the buses have sent since."""
        self._running()
        if received:
            self._handle(received)
        sent, self._sent = self._sent, {}
        return sent

    def _handle(self, received: Mapping[str, bytes]) -> None:
        assert self._events is not None
        for name, content in self._events.handle(self._now, received).items():
            self._sent[name] = self._sent.get(name, b"") + content

    def terminate(self) -> None:
        """End the FMU, free the instance and remove its files, even after a failure."""
        self._binding = None
        self._cleanup.close()

    def save(self) -> bytes:
        """The whole state of the instance. Raises ComponentError where the FMU cannot give it."""
        return self._serializable().save()

    def restore(self, state: bytes) -> None:
        """Put the instance back into a saved state; it must be initialized."""
        self._serializable().restore(state)
        gc.collect(1)  # ctypes leaves states in reference cycles; the collector counts objects, not their bytes

    def _changed_sizes(self) -> dict[str, NDArray[Any]]:
        """Sizes that differ from the start values of the FMU."""
        variables = self.description.variables
        changed = {n: size for n, size in self._sizes.items() if size != self.description.default_sizes[n]}
        return {name: variables[name].convert(size, {}) for name, size in changed.items()}

    def _checked(self, parameters: Mapping[str, object]) -> Iterator[tuple[str, NDArray[Any]]]:
        known = {n: v for n, v in self.description.parameters.items() if not v.is_size}
        for name, value in parameters.items():
            if name not in known:
                raise FmuError(f"{self.description.path}: {name} is no parameter; {nearest(name, known)}")
            try:
                yield name, known[name].convert(value, self._sizes)
            except ValueError as error:
                raise FmuError(f"{self.description.path}: {name} {error}") from error

    def _extract(self, path: Path) -> Path:
        if reason := platform_error(self.description):
            raise FmuError(f"{path}: {reason}")
        folder = self._cleanup.enter_context(temporary_folder("fmu"))
        try:
            with zipfile.ZipFile(path) as archive:
                if reason := unpacked_error(archive):
                    raise FmuError(f"{path}: {reason}")
                needed = [name for name in archive.namelist() if name.partition("/")[0] not in _UNUSED]
                archive.extractall(folder, needed)
        except UNREADABLE as error:
            self._cleanup.close()
            cause = f"it is damaged: {error}"
            if isinstance(error, OSError) and is_full(error):
                cause = f"{reason_of(error)} in {folder}; make room, or set TMPDIR to a folder on another disk"
            raise FmuError(f"{path}: cannot be unpacked, {cause}") from error
        return folder

    def _start(self) -> Binding:
        from inkloop.fmu.binding import Binding  # FMPy's classes, which only a running FMU needs

        here = Path.cwd()
        try:
            binding = Binding(self.description, self._name, self._folder)
        except Exception as error:  # the loader raises bare exceptions
            raise FmuError(f"{self.description.path}: the binary cannot be loaded: {error}") from error
        finally:
            os.chdir(here)  # the loader changes folder and stays there when it fails
        self._cleanup.callback(binding.unload)
        binding.instantiate()
        self._cleanup.callback(binding.free)
        return binding

    def _running(self) -> Binding:
        if self._binding is None:
            raise ComponentError(f"{self.description.name} was used before it was initialized or after its end")
        return self._binding

    def _serializable(self) -> Binding:
        if any(bus.tx_interval == COUNTDOWN for bus in self.description.buses):
            raise ComponentError(f"{self.description.name} cannot save its state: the clock of a bus counts down")
        if not self.description.can_serialize:
            raise ComponentError(f"{self.description.name} cannot save its state (canSerializeFMUState is false)")
        return self._running()

    def _set(self, binding: Binding, inputs: Values) -> None:
        is_whole = inputs.keys() >= self._input_names
        binding.set(self._inputs if is_whole else [port for port in self._inputs if port.name in inputs], inputs)
