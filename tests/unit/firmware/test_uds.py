"""The services of a node as ISO 14229-1 has them: order of checks, suppressed answers, sessions, addressing."""

from __future__ import annotations

from collections.abc import Iterator
from struct import unpack

import numpy as np
import pytest

from inkloop_hardware.protocol.codec import Frame
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import CURE, DONE, HEAD, PROFILER, STAGE, NodeBench, Nrc, pattern_blob

SUPPRESSED = 0x80
SERVICE, SUBFUNCTION, LENGTH, SEQUENCE, RANGE = 0x11, 0x12, 0x13, 0x24, 0x31
S3_MS = 5000
SESSION = b"\x22\xf1\x86"


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made.ready()


@pytest.mark.parametrize(
    ("node", "request_", "code"),
    [
        (HEAD, "11 01", SERVICE),
        (HEAD, "35", SERVICE),
        (PROFILER, "34", SERVICE),
        (STAGE, "34 00 44 00000001 00000010", SERVICE),
        (STAGE, "36 01", SERVICE),
        (CURE, "37", SERVICE),
        (HEAD, "10", LENGTH),
        (HEAD, "31", LENGTH),
        (HEAD, "3E", LENGTH),
        (HEAD, "22 F1", LENGTH),
        (HEAD, "34 00", LENGTH),
        (PROFILER, "35 00", LENGTH),
        (HEAD, "36", LENGTH),
        (HEAD, "10 02", SUBFUNCTION),
        (HEAD, "10 02 00", SUBFUNCTION),
        (HEAD, "10 82", SUBFUNCTION),
        (HEAD, "3E 01 00", SUBFUNCTION),
        (HEAD, "31 02", SUBFUNCTION),
        (HEAD, "31 85 02 00", SUBFUNCTION),
        (HEAD, "10 03 00", LENGTH),
        (HEAD, "3E 00 00", LENGTH),
        (HEAD, "31 01", LENGTH),
        (HEAD, "31 01 99 99", RANGE),
        (HEAD, "31 01 02 00", LENGTH),
        (HEAD, "22 99 99", RANGE),
        (HEAD, "22 01 03", RANGE),
        (HEAD, "36 01", SEQUENCE),
        (HEAD, "37", SEQUENCE),
    ],
)
def test_first_check_that_fails_names_the_code(bench: NodeBench, node: int, request_: str, code: int) -> None:
    """The service, the shortest request, the sub-function, then the checks of the service."""
    request = bytes.fromhex(request_)
    assert bench.raw(request, node) == bytes((0x7F, request[0], code))


def test_positive_answer_of_a_routine_is_suppressed_on_request(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(Routine.CLEAR, option=b"\0", kind=1 | SUPPRESSED)) == b""
    assert bench.raw(bench.routine(Routine.CLEAR, kind=3 | SUPPRESSED)) == b""
    assert bench.raw(bench.routine(Routine.DRY_RUN, option=b"\1", kind=1 | SUPPRESSED)) == b""
    assert bench.raw(bench.routine(Routine.CLEAR, option=b"\4", kind=1 | SUPPRESSED)) == bytes((0x7F, 0x31, RANGE))
    assert bench.raw(bench.routine(Routine.DRY_RUN, option=b"\0"))[:2] == b"\x71\x01", (
        "the node did what it did not answer"
    )
    assert bench.late() == b""


def test_answer_that_was_announced_by_still_busy_is_not_suppressed(bench: NodeBench) -> None:
    request = bench.routine(Routine.HOME, attempt=2, kind=1 | SUPPRESSED)
    assert bench.raw(request, STAGE) == b"\x7f\x31\x78"
    bench.tick(200)
    assert bench.late(STAGE)[:5] == b"\x71\x01\x02\x01" + bytes([DONE])
    assert bench.raw(request, STAGE) == b"", "done before"


def session_of(bench: NodeBench, node: int = HEAD) -> int:
    """Reading it is a request, too: it begins S3 again."""
    return bench.raw(SESSION, node)[3]


def test_extended_session_ends_s3_after_the_last_request(bench: NodeBench) -> None:
    assert session_of(bench) == 1
    assert bench.raw(b"\x10\x03")[:2] == b"\x50\x03"
    bench.tick(S3_MS - 5)
    assert session_of(bench) == 3
    bench.tick(S3_MS - 5)
    assert bench.raw(b"\x3e\x80") == b""
    bench.tick(S3_MS - 5)
    assert session_of(bench) == 3
    bench.tick(S3_MS)
    assert session_of(bench) == 1
    assert (session_of(bench, CURE), bench.raw(b"\x10\x83", CURE), session_of(bench, CURE)) == (1, b"", 3)
    assert bench.raw(b"\x10\x01", CURE)[:2] == b"\x50\x01"
    assert session_of(bench, CURE) == 1


def test_step_under_way_keeps_its_session() -> None:
    with NodeBench(scan_ms=2 * S3_MS) as bench:
        bench.ready()
        assert bench.raw(b"\x10\x03", PROFILER)[:2] == b"\x50\x03"
        assert bench.raw(bench.routine(Routine.SCAN), PROFILER) == b"\x7f\x31\x78"
        bench.tick(2 * S3_MS + 50)
        assert session_of(bench, PROFILER) == 3


def test_session_changes_no_condition(bench: NodeBench) -> None:
    """All services are in both sessions, as the page declares."""
    bench.stop(True)
    for session in (b"\x10\x01", b"\x10\x03"):
        bench.raw(session)
        assert bench.clear(HEAD, 1) == -Nrc.CONDITIONS
    bench.stop(False)
    assert bench.clear(HEAD, 1) == DONE


def flags_of(bench: NodeBench, node: int = HEAD) -> set[str]:
    names = ("needs operator", "stopped", "pattern", "dry run", "scanned", "damaged", "watchdog")
    bits = bench.raw(b"\x22\x01\x00", node)[6]
    return {name for bit, name in enumerate(names) if bits >> bit & 1}


def test_flags_of_the_state_are_told_apart(bench: NodeBench) -> None:
    assert flags_of(bench) == set()
    assert bench.scan(0) == DONE
    assert flags_of(bench, PROFILER) == {"scanned"}
    assert bench.raw(bench.routine(Routine.DRY_RUN, option=b"\1"))[4] == DONE
    assert flags_of(bench) == {"dry run"}
    assert bench.download(pattern_blob(np.ones((9, 8))), 1) == 0
    assert flags_of(bench) == {"dry run", "pattern"}
    bench.tear(10, PROFILER)
    bench.raw(bench.routine(Routine.SCAN, attempt=2), PROFILER)
    assert "damaged" in flags_of(bench, PROFILER)
    bench.stop(True)
    assert flags_of(bench) == {"needs operator", "stopped"}


def test_map_of_a_dry_run_is_gone_with_it(bench: NodeBench) -> None:
    assert bench.run(Routine.DRY_RUN, PROFILER, option=b"\1") == DONE
    assert bench.scan(0) == DONE
    assert flags_of(bench, PROFILER) == {"dry run", "scanned"}
    assert bench.run(Routine.DRY_RUN, PROFILER, attempt=2, option=b"\0") == DONE
    assert flags_of(bench, PROFILER) == set()
    assert bench.raw(b"\x22\1\3", PROFILER)[3:7] == bytes(4)


def test_limits_and_times_of_a_session_are_those_of_the_page(bench: NodeBench) -> None:
    """Bytes of a pattern (two bits a cell), alive, lamp, gate, pass, motion, scan [ms], bytes of a block."""
    found = unpack(">7IH", bench.raw(b"\x22\x01\x02")[3:])
    assert found == (18, 300, 10_000, 500, 120_000, 30_000, 60_000, 4095)
    assert bench.raw(b"\x22\x01\x02", CURE)[3:7] == bytes(4), "it takes no pattern"
    assert unpack(">HH", bench.raw(b"\x10\x03")[2:]) == (1000, 500), "P2 [ms], P2* [10 ms]"
    assert bench.raw(b"\x3e\x00") == b"\x7e\x00"
    with NodeBench(nx=5, ny=3) as odd:
        assert unpack(">I", odd.raw(b"\x22\x01\x02")[3:7]) == (4,)


def test_functional_address_reaches_no_node(bench: NodeBench) -> None:
    """As the page declares: a broadcast routine would begin on all nodes."""
    bench.join()
    bench.give(Frame(0x7DF, b"\x02\x10\x03"))
    assert [session_of(bench, node) for node in range(4)] == [1] * 4
    bench.give(Frame(0x642, b"\x02\x10\x03"))
    assert [session_of(bench, node) for node in range(4)] == [1, 3, 1, 1], "its own address does"
