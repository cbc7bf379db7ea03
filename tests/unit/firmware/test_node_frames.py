"""Supervised frames at a node: what is damaged has no effect, and a new session is judged by its own frames."""

from __future__ import annotations

from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import MasterAlive, StopRequest, pack
from inkloop_hardware.protocol.vocabulary import Source
from support.benches.node_bench import DONE, NodeBench

CODEC = Codec()


def damaged(frame: Frame) -> Frame:
    """The same with one bit of its check byte turned."""
    return Frame(frame.arbitration_id, bytes([frame.data[0] ^ 1]) + frame.data[1:])


def test_damaged_stop_request_neither_stops_nor_releases() -> None:
    with NodeBench() as bench:
        take = bench.ready().frames()
        stop, release = (pack(CODEC, StopRequest(active, Source.OPERATOR), 1) for active in (True, False))
        for frame, is_stopped in ((damaged(stop), False), (stop, True), (damaged(release), True), (release, False)):
            take(frame)
            assert bench.state().stopped is is_stopped


def alive(counter: int, session: int) -> Frame:
    return pack(CODEC, MasterAlive(True, True, True, session, 7), counter)


def test_errors_of_an_earlier_session_do_not_count_against_a_new_one() -> None:
    with NodeBench() as bench:
        bench.master = None
        take = bench.frames()
        for counter in (1, 2, 3):
            take(alive(counter, session=1))
            bench.tick(100)
        take(damaged(alive(4, session=1)))
        bench.tick(400)
        take(alive(9, session=2))
        assert bench.state().session == 2
        assert bench.clear() == DONE
