"""Frames, ISO-TP messages, requests and serial lines of any kind: the firmware's invariants hold.

Sanitizers find nothing either. The invariants are in tests/fuzz/firmware: lamp only with the gate confirmed closed,
all off in SAFE and FAULT, passes done never shrink, no pass opened twice, the journal can always be read,
answers fit their room ...
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.benches.node_bench import STATES
from support.fmus import fuzzing
from support.fmus.fuzzing import CORPUS, LONGEST_INPUT, TARGETS, Replay

pytestmark = [pytest.mark.compiled, pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")]
INPUTS = [(target, path) for target in TARGETS for path in fuzzing.corpus(target)]
OFF_BY_THEMSELVES = (1, 2, 3, 4, 5, 6, 7, 8, 12, 14, 16, 17, 19)  # causes that a node finds, inkloop.dbc


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every target with the address and undefined-behaviour sanitizers, without a fuzzer."""
    return fuzzing.build(tmp_path_factory.mktemp("replay"))


@pytest.fixture(scope="module")
def fuzzers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every target with libFuzzer."""
    compiler = fuzzing.clang()
    if compiler is None:
        pytest.skip("clang with libFuzzer is not installed; make tools")
    return fuzzing.build(tmp_path_factory.mktemp("fuzz"), compiler, fuzzer=True)


@pytest.mark.parametrize(("target", "path"), INPUTS, ids=[f"{target}-{path.name}" for target, path in INPUTS])
def test_invariants_hold_for_found_and_far_reaching_inputs(target: str, path: Path, programs: dict[str, Path]) -> None:
    done = subprocess.run([programs[target], path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def edited(seeds: list[bytes]) -> st.SearchStrategy[bytes]:
    """Two inputs of the corpus, cut and joined, with a few bytes changed."""
    edits = st.lists(st.tuples(st.integers(0, LONGEST_INPUT - 1), st.integers(0, 255)), max_size=6)
    pick, cut = st.sampled_from(seeds), st.integers(0, LONGEST_INPUT)

    def join(first: bytes, second: bytes, at: int, since: int, changes: list[tuple[int, int]]) -> bytes:
        joined = bytearray((first[:at] + second[since:])[:LONGEST_INPUT])
        for place, byte in changes:
            if place < len(joined):
                joined[place] = byte
        return bytes(joined)

    return st.builds(join, pick, pick, cut, cut, edits)


@pytest.mark.parametrize("target", TARGETS)
def test_invariants_hold_for_any_input(target: str, programs: dict[str, Path]) -> None:
    seeds = [path.read_bytes() for path in fuzzing.corpus(target)]

    with Replay(programs[target]) as replay:

        @settings(max_examples=200)
        @given(st.binary(max_size=LONGEST_INPUT) | edited(seeds))
        def check(given: bytes) -> None:
            broken = replay.feed(given)
            assert not broken, broken

        check()


def test_corpus_reaches_every_state_and_every_cause_of_a_node(programs: dict[str, Path]) -> None:
    """So that inputs whose meaning has changed are noticed."""
    states, causes = set[int](), set[int]()
    for target in ("frames", "services"):
        command = [programs[target], *fuzzing.corpus(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env={"INKLOOP_FUZZ_SHOWS": "1"})
        shown = re.findall(r"^state (\d+) cause (\d+)$", done.stderr, re.MULTILINE)
        states |= {int(state) for state, _ in shown}
        causes |= {int(cause) for _, cause in shown}
    assert states == set(range(len(STATES)))
    assert causes >= set(OFF_BY_THEMSELVES)


def test_corpus_is_small_and_named_after_what_it_reaches() -> None:
    assert sum(path.stat().st_size for _, path in INPUTS) < 20_000
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
    for _, path in INPUTS:
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", path.name), path


@pytest.mark.long
@pytest.mark.parametrize("target", TARGETS)
def test_fuzzer_finds_nothing_in_minutes(target: str, fuzzers: dict[str, Path], tmp_path: Path) -> None:
    """Ten minutes over all targets, another way each time."""
    assert not fuzzing.fuzz(target, fuzzers[target], 150, tmp_path / target)
