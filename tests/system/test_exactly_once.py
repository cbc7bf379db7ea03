"""Nodes, master or both are killed anywhere in a layer: no pass is jetted twice, none is left out, and all is reported.

Every print is killed many times over, at places that are spread over the whole cycle of a layer by the golden ratio;
each third one falls on a write of a journal, each third one into a pass or a cure that is under way.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from inkloop.errors import InkloopError
from inkloop.report.remarks import remarks
from inkloop.results.result import Result
from support.benches import kill_points
from support.benches.bench_run import BLOCK
from support.benches.kill_points import (
    Nodes,
    assert_printed_once,
    begin,
    books,
    clear,
    powered,
    session,
    session_killed_at,
)

pytestmark = [
    pytest.mark.usefixtures("without_pictures"),
    pytest.mark.skipif(sys.platform != "linux", reason="kill points are loaded by LD_PRELOAD"),
]
EXACT = BLOCK.replace("variation = 0.2", "variation = 0.0").replace("noise_std_um = 0.1", "noise_std_um = 0.0")
EXACT = EXACT.replace("dropout_rate = 0.02", "").replace("cure_ms = 2", "cure_ms = 30")
GOLDEN = 0.618034
LOOKS_OF_NODES = {"": 450, "j": 60, "s": 8}
LOOKS_OF_MASTER = {"": 350, "j": 60, "s": 8}
"""In a layer, about: all, at the journal, in steps."""
SESSIONS_MAX = 100
SIX_AND_THIRTY = [6, pytest.param(30, marks=pytest.mark.long)]
SIX_AND_TEN = [6, pytest.param(10, marks=pytest.mark.long)]


@pytest.fixture(scope="module")
def looks() -> Path:
    return kill_points.looks()


def part(folder: Path, deaths: int) -> Path:
    """A block that is high enough for so many of them."""
    path = folder / "part.toml"
    path.write_text(EXACT.replace("height_um = 15.0", f"height_um = {6.0 * deaths}"), encoding="utf-8")
    return path


def places(count: int, looks_of_a_layer: dict[str, int]) -> list[str]:
    """Where each life ends: 0.4 to 1.4 layers after its start, counted in looks of one kind."""
    kinds = list(looks_of_a_layer) * count
    shares = [0.4 + GOLDEN * number % 1 for number in range(1, count + 1)]
    return [f"{kind}{round(share * looks_of_a_layer[kind])}" for kind, share in zip(kinds, shares, strict=False)]


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
        if f"inkloop device {self._run} clear" in words:
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
    found = [words for words in remarks(result) if "was aborted" in words or "were aborted" in words]
    assert len(found) == bool(unknown)
    assert all(str(layer) in found[0] for layer in unknown)


@pytest.mark.parametrize("count", SIX_AND_THIRTY)
def test_killed_nodes_print_every_pass_once(count: int, looks: Path, tmp_path: Path) -> None:
    """Power fails and comes back at once: the run continues automatically where nothing is unknown."""
    path, run = part(tmp_path, count), tmp_path / "run"
    with powered(path, tmp_path / "nodes", looks, places(count, LOOKS_OF_NODES), pass_ms=20) as nodes:
        begin(path, run, nodes.channel)
        person = Person(run)
        result = person.finish()
        assert nodes.killed == count, "the part was finished before"
        assert_printed_once(result, run, nodes.folder)
        assert_all_is_reported(result, nodes, person)


def killed_masters(path: Path, folder: Path, looks: Path, count: int, *, with_nodes: bool) -> None:
    run = folder / "run"
    with powered(path, folder / "nodes", looks, pass_ms=150) as nodes:
        begin(path, run, nodes.channel)
        person = Person(run)
        for place in places(count, LOOKS_OF_MASTER):
            while words := session_killed_at(run, place, [nodes.process_id] if with_nodes else []):
                assert not words.startswith("done"), f"the part was finished before: {words}"
                person.look(words)
        result = person.finish()
        assert nodes.killed == count * with_nodes
        assert_printed_once(result, run, nodes.folder)
        assert_all_is_reported(result, nodes, person)


@pytest.mark.parametrize("count", SIX_AND_THIRTY)
def test_killed_master_prints_every_pass_once(count: int, looks: Path, tmp_path: Path) -> None:
    killed_masters(part(tmp_path, count), tmp_path, looks, count, with_nodes=False)


@pytest.mark.parametrize("count", SIX_AND_TEN)
def test_killed_master_and_nodes_print_every_pass_once(count: int, looks: Path, tmp_path: Path) -> None:
    killed_masters(part(tmp_path, count), tmp_path, looks, count, with_nodes=True)
