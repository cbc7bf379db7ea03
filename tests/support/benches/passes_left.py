"""State after a print that was killed: passes in the journal of the head, the surface on the bed, and the result."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.contract import pass_colours
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_controller.model import LayerModel
from inkloop_hardware.devices.master_journal import Asked, Event, MasterJournal, MasterRecord
from inkloop_hardware.protocol.node_state import Happening, JournalRecord, Step
from inkloop_hardware.protocol.services import Key

SECTOR_BYTES, RECORD_BYTES = 4096, 40
PASSES = 4
RESOLUTION = 1e-7


def head_journal(folder: Path) -> list[JournalRecord]:
    """The records of the head's memory, oldest first."""
    storage = (folder / "journal-head.bin").read_bytes()
    sectors = (storage[at : at + SECTOR_BYTES] for at in range(0, len(storage), SECTOR_BYTES))
    found = (one[at : at + RECORD_BYTES] for one in sectors for at in range(0, SECTOR_BYTES - 39, RECORD_BYTES))
    whole = [data for data in found if zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "big")]
    records = [record for data in whole for record in JournalRecord.of(data)]
    return sorted(records, key=lambda record: record.number)


def surface(folder: Path) -> Any:
    """The surface on the bed [m]."""
    data = (folder / "surface.bin").read_bytes()
    nx, ny = np.frombuffer(data, "=i4", 2, 8)
    return np.frombuffer(data, np.float64, offset=20).reshape(nx, ny)


def books(folder: Path) -> dict[int, JournalRecord]:
    """Final records of the head for each layer."""
    return {record.key.layer: record for record in head_journal(folder) if record.passes}


@dataclass(frozen=True)
class PassesLeft:
    """Numbers of passes of a part that were begun twice, and that a layer without an unknown pass lacks."""

    doubled: int
    skipped: int


def passes_left(result: Result, nodes: Path) -> PassesLeft:
    """By the head's journal: its INTENTs, and what it remembers of each layer that the result has."""
    begun, known = begun_passes(nodes), books(nodes)
    done = [(book.done, book.unknown) for book in map(known.get, range(1, result.dataset.sizes["layer"])) if book]
    missing_layers = result.dataset.sizes["layer"] - 1 - len(done)
    return PassesLeft(
        doubled=len(begun) - len({(key.layer, key.pass_) for key in begun}),
        skipped=PASSES * missing_layers + sum(PASSES - whole.bit_count() for whole, unknown in done if not unknown),
    )


def begun_passes(nodes: Path) -> list[Key]:
    """The keys of all passes that the head began, in any attempt."""
    intents = (record for record in head_journal(nodes) if record.kind is Happening.INTENT)
    return [record.key for record in intents if record.step is Step.PASS]


def assert_printed_once(result: Result, run: Path, nodes: Path) -> None:
    """The part is finished; no pass was begun twice, none is missing that is not called unknown, by head and result;
    the master had recorded each one before it requested it; no wet ink was scanned; and the surface on the bed is that
    of the droplets jetted, to the bit.
    """
    assert result.stop_reason == "done"
    layers, known = result.dataset.sizes["layer"], books(nodes)
    assert sorted(known) == list(range(1, layers))
    unknown = {layer for layer, book in known.items() if book.unknown}
    assert set(np.flatnonzero(result.dataset.layer_unknown)) == unknown
    begun, left = begun_passes(nodes), passes_left(result, nodes)
    assert (left.doubled, left.skipped) == (0, 0)
    assert {(key.layer, key.pass_) for key in begun} == {
        (n, k) for n, book in known.items() for k in range(4) if (book.done | book.unknown) >> k & 1
    }
    asked = {(record.key, record.pattern_crc) for record in MasterJournal(run).records if record.asked is Asked.PASS}
    assert {(key, known[key.layer].pattern_crc) for key in begun} <= asked
    for at, scan in enumerate(MasterJournal(run).records):
        if scan.asked is Asked.SCAN:
            _assert_no_ink_is_wet(scan.key.layer, MasterJournal(run).records[:at], known)
    height, possible = surface(nodes), _possible(result, known)
    assert any(np.array_equal(height, one) for one in possible), "the surface is of other passes"


def _assert_no_ink_is_wet(layer: int, before: Sequence[MasterRecord], known: dict[int, JournalRecord]) -> None:
    """All that was begun in a layer is cured before it is scanned, and nothing of the next one is begun."""
    cured = {r.key.pass_ for r in before if (r.asked, r.event, r.key.layer) == (Asked.CURE, Event.DONE, layer)}
    begun = known[layer].done | known[layer].unknown if layer else 0
    assert {number for number in range(4) if begun >> number & 1} <= cured, f"layer {layer} was scanned wet"
    assert max((r.key.layer for r in before if r.asked is Asked.PASS), default=0) <= layer


def _possible(result: Result, known: dict[int, JournalRecord]) -> list[Any]:
    """Surfaces that fit to the scans [m]; an unknown pass may have ended at any line."""
    job = Scenario.of_text(result.scenario_text, "run").job()
    possible, colour_of = [np.zeros((job.nx, job.ny))], 2 * (np.indices((job.nx, job.ny))[0] % 2)
    colour_of = colour_of + np.indices((job.nx, job.ny))[1] % 2
    model, line = LayerModel.of(job), np.indices((job.nx, job.ny))[0]
    for layer, book in sorted(known.items()):
        pattern, measured = (result.dataset[name].values[layer] for name in ("pattern", "measured_height"))
        for number, colour in enumerate(pass_colours(job.passes, job.pass_order, job.pass_rotation, layer)):
            ends = [job.nx] if book.done >> number & 1 else range(job.nx + 1) if book.unknown >> number & 1 else []
            jetted = [np.where((colour_of == colour) & (line < end), pattern, 0).astype(np.int32) for end in ends]
            possible = [model.layer(height, one, layer) for height in possible for one in jetted or [0 * pattern]]
        fitting = (height for height in possible if np.abs(height - measured).max() < 0.51 * RESOLUTION)
        possible = list({height.tobytes(): height for height in fitting}.values())
        assert possible, f"the scan of layer {layer} is of other passes than those in the head's journal"
    return possible
