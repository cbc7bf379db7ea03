"""Prints on the emulator that are killed again and again at random moments: what was jetted twice, and what never."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from support.benches.kill_points import Nodes, begin, powered, session_killed_when
from support.benches.killed_prints import Person, part
from support.benches.passes_left import begun_passes, is_surface_of_passes, passes_left

HEADS = (
    "killed (-9)", "kills", "layers", "passes begun", "begun twice", "left out",
    "cut short", "reported", "given up", "bed",
)  # fmt: skip
KILLS = 20
"""In each print."""
LIFE_S = 3.0
"""At most, from the first pass of a life on, about a layer; of every third life from its start."""
PASS_MS = 400
"""Longer than nodes wait for MasterAlive."""


def rows() -> Iterator[tuple[str, ...]]:
    """A row for each print."""
    for seed, killed in enumerate(("nodes", "master", "both")):
        lives = np.random.default_rng(seed).uniform(0.0, LIFE_S, KILLS).tolist()
        with tempfile.TemporaryDirectory() as folder:
            yield killed, *_figures(killed, lives, Path(folder))


def _figures(killed: str, lives: Sequence[float], folder: Path) -> tuple[str, ...]:
    run, person = folder / "run", Person(folder / "run")
    with powered(part(folder, 3 * KILLS // 2), folder / "nodes", None, pass_ms=PASS_MS) as nodes:
        begin(folder / "part.toml", run, nodes.channel)
        if killed == "nodes":
            threading.Thread(target=_kill, args=(nodes, lives), daemon=True).start()
        else:
            for number, seconds in enumerate(lives):
                victims = nodes if killed == "both" else None
                while words := session_killed_when(run, Life(number, seconds, nodes), victims):
                    person.look(words)
        result = person.finish()
        assert killed == "master" or nodes.killed == KILLS, "the part was finished before"
        left = passes_left(result, nodes.folder)
        layers = result.dataset.sizes["layer"] - 1
        bed = "of these passes, to the bit" if is_surface_of_passes(result, nodes.folder) else "DIFFERS"
    counts = (KILLS, layers, left.begun, left.doubled, left.skipped, left.unknown, len(person.unknown), left.given_up)
    return *(str(count) for count in counts), bed


class Life:
    """Whether so many seconds have passed, called again and again: since its start, or since the head began a pass."""

    def __init__(self, number: int, seconds: float, nodes: Nodes) -> None:
        self._seconds, self._nodes = seconds, nodes.folder
        self._begun = len(begun_passes(self._nodes))
        self._since = None if number % 3 else time.monotonic()

    def __call__(self) -> bool:
        if self._since is None and len(begun_passes(self._nodes)) > self._begun:
            self._since = time.monotonic()
        return self._since is not None and time.monotonic() - self._since > self._seconds


def _kill(nodes: Nodes, lives: Sequence[float]) -> None:
    for number, seconds in enumerate(lives):
        is_over = Life(number, seconds, nodes)
        while not is_over():
            time.sleep(0.01)
        while nodes.killed <= number:
            nodes.kill()
            time.sleep(0.02)
