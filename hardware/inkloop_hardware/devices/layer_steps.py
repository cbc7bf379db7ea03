"""Steps of one layer on the bench: pattern, then for each pass stage, head, stage, lamp; then a scan.

Every step has a key, so that a repeated request is answered "done before" and nothing happens twice; the master's
journal records it before the request. Outputs are enabled only for the step that needs them. Nothing is timed here: the
stage's encoder fires the droplets, nodes end steps.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from struct import pack
from typing import Any
from zlib import crc32

from numpy.typing import NDArray

from inkloop.component import Job
from inkloop.contract import pass_colours
from inkloop.units import KILO, MS_PER_S
from inkloop_hardware.devices.master_journal import Asked, MasterJournal
from inkloop_hardware.devices.readiness import MARGIN_S, NotReady, missing
from inkloop_hardware.errors import HardwareError, NodeRefused, TransferError
from inkloop_hardware.link.link import CONDITIONS
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.node_state import Flags, LayerFlags, NodeLimits, NodeState
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Routine, Station
from inkloop_hardware.protocol.transfer_bytes import PatternBytes

ALL_COLOURS = 255
JOURNALLED = {Routine.PASS: Asked.PASS, Routine.CURE: Asked.CURE, Routine.SCAN: Asked.SCAN}
OUT_OF_RANGE = 0x31
LOGGED_FROM_BYTES = 50_000  # smaller transfers take less than two seconds on any bus

_log = logging.getLogger("inkloop_hardware")


@dataclass(frozen=True)
class PrintedLayer:
    """Result of a layer. passes: colours of the passes that were jetted whole, in their order.

    is_unknown: it was given up midway; the other passes were never begun or their progress is unknown.
    """

    passes: tuple[int, ...]
    is_unknown: bool = False


class LayerSteps:
    """Prints and scans the layers of a job. limits: of the nodes, see `readiness.make_ready`; dry: no jet and no lamp.

    journal: the master's, in memory only if None. Every call raises HardwareError with the node, the request, the
    answer, and what to do.
    """

    def __init__(
        self,
        rig: Rig,
        job: Job,
        limits: Mapping[Node, NodeLimits],
        *,
        cure_ms: int = 100,
        dry: bool = False,
        journal: MasterJournal | None = None,
    ) -> None:
        self._rig, self._job, self._limits = rig, job, limits
        self._cure_ms, self._dry = cure_ms, dry
        self._journal = journal or MasterJournal()
        self._pattern_crc = 0
        self._takes_coded = True
        if Node.CURE in limits and cure_ms / MS_PER_S >= limits[Node.CURE].lamp:
            raise NotReady(
                f"cure: bench.cure_ms is {cure_ms}; this lamp switches itself off after "
                f"{limits[Node.CURE].lamp * MS_PER_S:.0f} ms: set a smaller one"
            )

    def print_layer(self, layer: int, pattern: NDArray[Any]) -> PrintedLayer:
        """Print and cure one layer; steps that are done by the journals are not repeated.

        pattern: (nx, ny), 0 none, 1 material A, 2 material B. A layer that was given up midway is only cured: the next
        scan shows its result. ValueError for a pattern that the bus cannot carry.
        """
        job = self._job
        colours = pass_colours(job.passes, job.pass_order, job.pass_rotation, layer) or (ALL_COLOURS,)
        made = PatternBytes.of(pattern, passes=job.passes, materials=len(job.inks))
        state = self._rig.link(Node.HEAD).state()
        self._pattern_crc = state.pattern_crc
        if (state.job, state.layer) != (self._rig.job, layer) or not state.passes:
            self._download(layer, made)
            done = 0
        else:
            done = state.done
            if state.unknown or (state.layer_flags & LayerFlags.ABANDONED and not state.layer_is_complete):
                return self._cure_given_up(layer, state, colours)
            self._restore_pattern(layer, made, state)
        for number, colour in enumerate(colours):
            if not done >> number & 1:
                self._jet(layer, number, colour)
            self._cure(layer, number)
        return PrintedLayer(colours)

    def scan(self, layer: int) -> bytes:
        """Scan the surface and fetch the map; a map whose transfer fails is scanned once more."""
        self._go(Station.SCAN, layer, 0)
        try:
            return self._scanned(layer, 1)
        except TransferError as error:
            _log.warning("profiler: the map of layer %d is scanned again: %s", layer, error)
            return self._scanned(layer, 2)

    def _scanned(self, layer: int, attempt: int) -> bytes:
        _log.info("profiler: scan of layer %d", layer)
        with self._rig.enabled(motion=True):
            self._do(Node.PROFILER, Routine.SCAN, Key(self._rig.job, layer, 0, attempt))
        return self._rig.link(Node.PROFILER).upload(layer, progress=_log_quarters(f"profiler: map of layer {layer}"))

    def _cure_given_up(self, layer: int, state: NodeState, colours: tuple[int, ...]) -> PrintedLayer:
        """Cure the droplets of a layer that is not to be jetted any more."""
        _log.warning("head: layer %d was given up midway and stays so; the scan shows its result", layer)
        for number in range(len(colours)):
            if (state.done | state.unknown) >> number & 1:
                self._cure(layer, number)
        whole = tuple(colour for number, colour in enumerate(colours) if state.done >> number & 1)
        return PrintedLayer(whole, is_unknown=True)

    def _restore_pattern(self, layer: int, made: PatternBytes, state: NodeState) -> None:
        """Send the pattern of a layer that the head has begun, if the head has lost it."""
        if not state.done:
            self._download(layer, made)
            return
        form = _form_begun(state, made)
        _log.info("head: layer %d was begun before and is continued", layer)
        if not state.layer_is_complete and not state.flags & Flags.PATTERN_LOADED:
            self._send(layer, made.coded if form else made.plain, coded=form)

    def _download(self, layer: int, made: PatternBytes) -> None:
        """Send the shorter form; the plain one to a head without the coded form, an option of the protocol."""
        if made.is_shorter_coded and self._takes_coded:
            try:
                self._send(layer, made.coded, coded=True)
                return
            except NodeRefused as error:
                if error.code != OUT_OF_RANGE:
                    raise
                self._takes_coded = False
        self._send(layer, made.plain, coded=False)

    def _send(self, layer: int, blob: bytes, *, coded: bool) -> None:
        self._pattern_crc, key = crc32(blob), Key(self._rig.job, layer)
        self._journal.intend(Asked.PATTERN, key, self._pattern_crc)
        progress = _log_quarters(f"head: pattern of layer {layer}")
        self._rig.link(Node.HEAD).download(layer, blob, coded=coded, progress=progress)
        self._journal.done(Asked.PATTERN, key, self._pattern_crc)

    def _jet(self, layer: int, number: int, colour: int) -> None:
        self._go(Station.PRINT, layer, number)
        _log.info("head: %s", self._which(layer, number))
        with self._rig.enabled(gate=not self._dry, motion=True):
            self._do(Node.HEAD, Routine.PASS, Key(self._rig.job, layer, number), bytes([colour]))

    def _cure(self, layer: int, number: int) -> None:
        self._go(Station.CURE, layer, number)
        _log.info("cure: lamp on for %d ms after %s", self._cure_ms, self._which(layer, number))
        with self._rig.enabled(lamp=not self._dry):
            self._do(Node.CURE, Routine.CURE, Key(self._rig.job, layer, number), pack(">H", self._cure_ms))

    def _which(self, layer: int, number: int) -> str:
        return f"pass {number + 1} of {self._job.passes}, layer {layer}" + ", dry" * self._dry

    def _go(self, station: Station, layer: int, number: int) -> None:
        """Move the stage. The station takes the place of the attempt: two moves of one pass never share a key."""
        with self._rig.enabled(motion=True):
            self._do(Node.STAGE, Routine.MOVE, Key(self._rig.job, layer, number, int(station)), bytes([station]))

    def _do(self, node: Node, routine: Routine, key: Key, option: bytes = b"") -> None:
        limits = self._limits[node]
        longest_s = {
            Routine.PASS: limits.pass_ + 2 * limits.gate,
            Routine.CURE: limits.lamp + limits.gate,
            Routine.SCAN: limits.scan,
        }.get(routine, limits.motion)
        asked = None if self._dry else JOURNALLED.get(routine)
        if asked is not None:
            self._journal.intend(asked, key, self._pattern_crc)
        try:
            self._rig.link(node).routine(routine, key, option, limit_s=longest_s + MARGIN_S)
        except NodeRefused as error:
            if reasons := missing(node, self._rig.status(node)) if error.code == CONDITIONS else []:
                raise NodeRefused(f"{error}. By its status: {'. '.join(reasons)}", error.code) from error
            raise
        if asked is not None:
            self._journal.done(asked, key, self._pattern_crc)


def _form_begun(state: NodeState, made: PatternBytes) -> bool:
    """Whether the pattern of a begun layer was sent coded. HardwareError if it was another one."""
    form = made.form_of(state.pattern_crc)
    if form is None:
        raise HardwareError(
            f"head: layer {state.layer} was begun with another pattern (CRC-32 {state.pattern_crc:08x}) than the "
            "present one; was the scenario changed? `inkloop bench clear SCENARIO --give-up` gives that layer up"
        )
    return form


def _log_quarters(what: str) -> Callable[[int, int], None]:
    """Progress of a transfer that logs each quarter of a long one."""
    quarters = 0

    def log(through: int, total: int) -> None:
        nonlocal quarters
        if total >= LOGGED_FROM_BYTES and through * 4 // total > quarters:
            quarters = through * 4 // total
            _log.info("%s: %d of %d kB", what, through // KILO, total // KILO)

    return log
