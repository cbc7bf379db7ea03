"""Present content of the live page: the newest content of a run folder, and its changes for each page."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from inkloop.errors import InkloopError
from inkloop.report.page.content import content
from inkloop.report.page.devices import devices
from inkloop.report.page.maps import FINAL_CELLS, LayerMaps
from inkloop.report.page.page import MAPS_BYTES_MAX, PACKED_SHARE, first_block
from inkloop.results.result import Result

LOOKS_PER_STATE = 8
"""Looks at the files per look at the lock of the run, which must not block a run that begins at that moment."""
ROOM = 1.5
"""Room for layers on a page, relative to the least number that the scenario needs: the last layers are not full."""


class Source(Protocol):
    """A run folder that is read again and again, see `inkloop.printing.so_far`."""

    def stamps(self) -> Mapping[Path, object]:
        """The files that `runs` reads; equal if nothing has changed."""

    def runs(self) -> dict[str, Result]:
        """The run first, then its comparison runs, by name. Raises InkloopError."""


class Feed:
    """The newest content of `source`; `version` grows with each change.

    state: a sentence on a run that has not ended; log: of its devices, a file that may not exist; layers: expected for
    each run. A page gets all layers that it does not have yet, even after missed changes.
    """

    def __init__(self, source: Source, state: Callable[[], str], log: Path, layers: int) -> None:
        self._source, self._state, self._log, self._layers = source, state, log, layers
        self._lock = threading.Lock()
        self._seen: object = None
        self._runs: dict[str, Result] = {}
        self._maps: dict[str, LayerMaps] = {}
        self._epoch, self._looks, self._problem, self._owner = 0, 0, "", ""
        self.version = 0

    def refresh(self) -> bool:
        """Read what has changed; whether anything has."""
        if self._looks % LOOKS_PER_STATE == 0:
            self._owner = self._state()
        self._looks += 1
        seen = (self._owner, self._source.stamps(), _length(self._log))
        if seen == self._seen:
            return False
        with self._lock:
            try:
                self._take(self._source.runs())
                self._problem = ""
            except (InkloopError, OSError) as error:
                self._problem = str(error)
            self._seen = seen
            self.version += 1
        return True

    def content(self, epoch: str = "", known: Sequence[int] = ()) -> dict[str, Any]:
        """The content for a page that has so many layers of each run; all layers if it is of another epoch."""
        with self._lock:
            if self._problem or not self._runs:
                return {"problem": self._problem or "No layer is finished yet."}
            is_same = (epoch, len(known)) == (str(self._epoch), len(self._runs))
            cells = FINAL_CELLS / len(self._runs)
            try:
                found = content(self._runs, list(self._maps.values()), known if is_same else (), cells)
            except InkloopError as error:  # a run has ended since the last look
                return {"problem": str(error)}
            found["state"] = f"{found['state']} {self._owner}".rstrip()
            return {**found, "epoch": str(self._epoch), "devices": devices(self._log)}

    def _take(self, runs: dict[str, Result]) -> None:
        """Add the new layers to the maps; begin again where a run has fewer layers, or the blocks become too small."""
        expected = max(self._layers, *(result.dataset.sizes["layer"] for result in runs.values())) * len(runs)
        block = first_block(runs, MAPS_BYTES_MAX / PACKED_SHARE, round(ROOM * expected))
        is_shorter = any(
            name in self._maps and len(self._maps[name].heights) > result.dataset.sizes["layer"]
            for name, result in runs.items()
        )
        blocks = {maps.blocks.block for maps in self._maps.values()}
        if is_shorter or any(old < block for old in blocks):
            self._maps, blocks = {}, set()
            self._epoch += 1
        block = max(blocks, default=block)
        for name, result in runs.items():
            if name not in self._maps:
                self._maps[name] = LayerMaps(result.dataset, block)
            elif self._runs.get(name) is not result:
                self._maps[name].extend(result.dataset)
        self._maps = {name: self._maps[name] for name in runs}
        self._runs = runs


def _length(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
