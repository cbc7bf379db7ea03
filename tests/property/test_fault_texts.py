"""The text of a fault: what the command line takes the program of the nodes takes, and nothing brings it down."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from inkloop.errors import InkloopError
from inkloop.tables.bench_faults import read_fault
from support.benches.node_bench import FIRMWARE, PLACES, STRICT
from support.compiled import program
from support.places import C_SOURCES

pytestmark = pytest.mark.compiled
WORDS = st.sampled_from(
    ["loss", "reboot", "swap", ":", ",", "=", "node=head", "nth=4", "nth=0x10", "probability=1e-3", "probability=nan",
     "way=to-nodes", "id=0x640", "byte=7", "pass=3", "seed=0", "layer=65535", "count=4294967295", "frames=-1", "x" * 80,
     "hang", "broken", "part=end-switches"]
)  # fmt: skip
TEXTS = st.lists(WORDS, min_size=1, max_size=6).map(",".join).map(lambda text: text.replace(",", ":", 1))
REASONS = (b"no fault is called", b"give probability or nth", b"it needs node=", b"it needs part=")
ANY_TEXT = st.text(st.characters(exclude_characters="\0\n", exclude_categories=["Cs"]), max_size=100)


@pytest.fixture(scope="module")
def nodes() -> Iterator[subprocess.Popen[bytes]]:
    """The reader of the emulator, with sanitizers."""
    if not shutil.which("gcc"):
        pytest.skip("gcc is not installed")
    sources = [FIRMWARE / "host" / "faults" / "fault_text.c", C_SOURCES / "fault_text_probe.c"]
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    reader = program("fault_text", sources, (*STRICT, *sanitizers, *PLACES))
    with subprocess.Popen([reader], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield process
        assert process.stdin is not None
        process.stdin.close()


@settings(max_examples=200)
@given(text=TEXTS | ANY_TEXT)
@example(text="loss:" + "x" * 80 + "=1")
def test_fault_that_is_taken_is_taken_by_the_nodes_too(text: str, nodes: subprocess.Popen[bytes]) -> None:
    try:
        written = str(read_fault(text))
    except InkloopError:
        written = None
    for given_ in (text, written or text):
        assert nodes.stdin is not None
        assert nodes.stdout is not None
        nodes.stdin.write(f"{len(given_.encode())}\n".encode() + given_.encode())
        nodes.stdin.flush()
        answer = nodes.stdout.readline().strip()
        assert answer == b"taken" or answer.startswith(REASONS) or b" of " in answer, answer
    assert written is None or answer == b"taken", written


def test_word_that_is_too_long_for_a_kind_is_not_shown(nodes: subprocess.Popen[bytes]) -> None:
    assert nodes.stdin is not None
    assert nodes.stdout is not None
    nodes.stdin.write(b"80\n" + b"x" * 80)
    nodes.stdin.flush()
    assert nodes.stdout.readline() == b"no fault is called \n"
