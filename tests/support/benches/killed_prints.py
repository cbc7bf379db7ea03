"""Prints whose nodes, master or both are killed many times over, and the person who looks after them."""

from __future__ import annotations

import re
from pathlib import Path

from inkloop.errors import InkloopError
from inkloop.report.remarks import remarks
from inkloop.results.result import Result
from support.benches.bench_run import BLOCK
from support.benches.kill_points import Nodes, clear, session
from support.benches.passes_left import books

EXACT = BLOCK.replace("variation = 0.2", "variation = 0.0").replace("noise_std_um = 0.1", "noise_std_um = 0.0")
EXACT = EXACT.replace("dropout_rate = 0.02", "").replace("cure_ms = 2", "cure_ms = 30")
SESSIONS_MAX = 100


def part(folder: Path, deaths: int) -> Path:
    """A block that is high enough for so many of them."""
    path = folder / "part.toml"
    path.write_text(EXACT.replace("height_um = 15.0", f"height_um = {6.0 * deaths}"), encoding="utf-8")
    return path


class Person:
    """Clears the nodes where one of them asks for it, and only there, and resumes the run; `unknown` are the
    passes of unknown outcome."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self.unknown: set[tuple[int, int]] = set()

    def look(self, words: str) -> None:
        """The message names what the person has to do."""
        assert "inkloop resume" in words, words
        for passes, layer in re.findall(
            r"pass ([1-4, ]+) of layer (\d+), which was begun and whose progress is unknown", words
        ):
            self.unknown |= {(int(layer), int(number) - 1) for number in passes.split(", ")}
        if "inkloop bench clear SCENARIO" in words:
            assert f"`inkloop bench` takes {self._run} as SCENARIO" in words
            clear(self._run)

    def finish(self) -> Result:
        """Print to the end."""
        for _ in range(SESSIONS_MAX):
            found = session(self._run)
            if isinstance(found, Result):
                return found
            assert isinstance(found, InkloopError)
            self.look(str(found))
        raise AssertionError("it never ends")


def assert_all_is_reported(result: Result, nodes: Nodes, person: Person) -> None:
    """Every pass that was cut short was reported as unknown before the print continued, and the result records it."""
    unknown = {layer: book.unknown for layer, book in books(nodes.folder).items() if book.unknown}
    assert person.unknown == {(layer, k) for layer, mask in unknown.items() for k in range(4) if mask >> k & 1}
    aborted = [words for words in remarks(result) if "was aborted" in words or "were aborted" in words]
    assert len(aborted) == bool(unknown)
    assert all(str(layer) in aborted[0] for layer in unknown)
