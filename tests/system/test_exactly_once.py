"""Nodes, master or both are killed anywhere in a layer: no pass is jetted twice, none is left out, and all is reported.

Every print is killed many times over, at places that are spread over the whole cycle of a layer by the golden ratio;
each third one falls on a write of a journal, each third one into a pass or a cure that is under way.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop_hardware.protocol.node_state import Happening, JournalRecord, LayerFlags, Step
from support.benches import kill_points, passes_left
from support.benches.kill_points import begin, powered, session_killed_at, session_killed_when
from support.benches.killed_prints import Person, assert_all_is_reported, part
from support.benches.passes_left import PASSES, assert_printed_once
from support.long_proofs import rest_is_long

pytestmark = [
    pytest.mark.usefixtures("without_pictures"),
    pytest.mark.skipif(sys.platform != "linux", reason="kill points are loaded by LD_PRELOAD"),
]
GOLDEN = 0.618034
LOOKS_OF_NODES = {"": 450, "j": 60, "s": 8}
LOOKS_OF_MASTER = {"": 350, "j": 60, "s": 8}
"""In a layer, about: all, at the journal, in steps."""
RANDOM_KILLS, RANDOM_PASS_S = 60, 0.15


@pytest.fixture(scope="module")
def looks() -> Path:
    return kill_points.looks()


def places(count: int, looks_of_a_layer: dict[str, int]) -> list[str]:
    """End of each life: 0.4 to 1.4 layers after its start, counted in looks of one kind."""
    kinds = list(looks_of_a_layer) * count
    shares = [0.4 + GOLDEN * number % 1 for number in range(1, count + 1)]
    return [f"{kind}{round(share * looks_of_a_layer[kind])}" for kind, share in zip(kinds, shares, strict=False)]


def test_passes_begun_twice_and_left_out_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Layer 1 whole, of which pass 2 was begun again; layer 2 cut short in pass 1; layer 3 without its last pass."""
    begun = [(1, 0), (1, 1), (1, 2), (1, 2), (1, 3), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)]
    ends = {1: (0b1111, 0), 2: (0b0001, 0b0010), 3: (0b0111, 0)}

    def record(kind: Happening, layer: int, number: int, done: int, unknown: int) -> JournalRecord:
        progress = (PASSES, done, unknown, 0, LayerFlags(0), 0.0, 0, 0)
        return JournalRecord(1, kind, Step.PASS, number, 1, 7, layer, 1, 0, *progress)

    journal = [record(Happening.INTENT, layer, number, *ends[layer]) for layer, number in begun]
    monkeypatch.setattr(passes_left, "head_journal", lambda nodes: journal)
    result: Any = SimpleNamespace(dataset=SimpleNamespace(sizes={"layer": 4}))
    found = passes_left.passes_left(result, tmp_path)
    assert found == passes_left.PassesLeft(doubled=1, skipped=1)


@pytest.mark.long
@pytest.mark.parametrize("count", [6, 30])
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


@pytest.mark.long
@pytest.mark.parametrize("count", [6, 30])
def test_killed_master_prints_every_pass_once(count: int, looks: Path, tmp_path: Path) -> None:
    killed_masters(part(tmp_path, count), tmp_path, looks, count, with_nodes=False)


class Moment:
    """A moment of a print: the head has written `writes` more times to its memory, then `delay` s have passed."""

    def __init__(self, memory: Path, writes: int, delay: float) -> None:
        self._memory, self._left, self._delay = memory, writes, delay
        self._seen = memory.read_bytes()

    def __call__(self) -> bool:
        now = self._memory.read_bytes()
        self._left, self._seen = self._left - (now != self._seen), now
        if self._left <= 0:
            time.sleep(self._delay)
        return self._left <= 0


@pytest.mark.long
def test_master_killed_at_sixty_random_moments_prints_every_pass_once(looks: Path, tmp_path: Path) -> None:
    """From outside, at the same moments in every run: up to a layer after the last, anywhere in a pass or a cure."""
    path, run, draw = part(tmp_path, RANDOM_KILLS // 2), tmp_path / "run", np.random.default_rng(48)
    words: list[str | None] = []
    with powered(path, tmp_path / "nodes", looks, pass_ms=1e3 * RANDOM_PASS_S) as nodes:
        begin(path, run, nodes.channel)
        person, memory = Person(run), nodes.folder / "journal-head.bin"
        while words.count(None) < RANDOM_KILLS:
            moment = Moment(memory, int(draw.integers(1, 8)), draw.uniform(0, RANDOM_PASS_S))
            words.append(session_killed_when(run, moment))
            if words[-1] is not None:
                assert not words[-1].startswith("done"), f"the part was finished after {words.count(None)} kills"
                assert len(words) < 4 * RANDOM_KILLS, "most sessions end before they are killed"
                person.look(words[-1])
        result = person.finish()
        assert_printed_once(result, run, nodes.folder)
        assert_all_is_reported(result, nodes, person)
        left, begun = passes_left.passes_left(result, nodes.folder), len(passes_left.begun_passes(nodes.folder))
        print(f"{words.count(None)} kills, {begun} passes begun: {left}, {len(person.unknown)} unknown and named")


@pytest.mark.parametrize("count", rest_is_long([3, 10], 1))
def test_killed_master_and_nodes_print_every_pass_once(count: int, looks: Path, tmp_path: Path) -> None:
    killed_masters(part(tmp_path, count), tmp_path, looks, count, with_nodes=True)
