"""Faults that could injure a person, one by one: the node's answer, its state, its cause and its newest record."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Happening, Step
from inkloop_hardware.protocol.records import Fault, Source, StopRequest, pack
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import CURE, GATE, HEAD, LAMP, MOTION, Broken, MasterAlive, NodeBench, pattern_blob

CODEC = Codec()
FULL = np.ones((9, 8), np.uint8)
CONTRADICTION = Broken.GATE_STAYS_OPEN | Broken.GATE_STAYS_CLOSED
LONG_MS, WRAP_MS, HANGS_MS = 5000, 1 << 32, 3000
PASS_REQUEST, CURE_REQUEST = b"\0", b"\x0f\xa0"
HEADS = ("what goes wrong", "asked or under way", "answer", "state, cause", "newest record")
Row = tuple[str, str, str, str, str]


@contextmanager
def bench(*, one_node: bool = False, watchdog_ms: int = 300, passes: int = 4) -> Iterator[NodeBench]:
    """Ready to jet the first pass of layer 1."""
    with NodeBench(pass_ms=LONG_MS, one_node=one_node, watchdog_ms=watchdog_ms) as made:
        made.ready().join()
        assert made.download(pattern_blob(FULL, passes=passes), 1) == 0
        yield made


def words(made: NodeBench, answer: bytes, node: int) -> tuple[str, str, str]:
    """Answer, state and newest record as the page has them."""
    state = made.state(node)
    kind, step, number = made.journal(node)[-1]
    cause = f", {Fault(state.cause).name}" if state.cause else ""
    refused = "none" if not answer else f"0x{answer[2]:02X}" if answer[0] == 0x7F else "done"
    step_name = f" {Step(step).name.lower()} {number + 1}" if step else ""
    return refused, state.state + cause, Happening(kind).name + step_name


def asked(made: NodeBench, request: bytes, node: int = HEAD) -> tuple[str, str, str]:
    return words(made, made.ask(request, node), node)


def under_way(made: NodeBench, happen: Callable[[], object], node: int = HEAD) -> tuple[str, str, str]:
    """A pass of the head, or a cure, in which something happens."""
    routine, option = (Routine.PASS, PASS_REQUEST) if node == HEAD else (Routine.CURE, CURE_REQUEST)
    assert made.raw(made.routine(routine, 1, option=option), node) == b"\x7f\x31\x78"
    made.tick(200)
    happen()
    made.tick(600)
    return words(made, made.late(node), node)


def stopped(made: NodeBench, *actives: bool) -> None:
    for counter, active in enumerate(actives):
        made.give(pack(CODEC, StopRequest(active, Source.OPERATOR), counter))


def hang(made: NodeBench) -> None:
    made.clock += HANGS_MS


def of_masters() -> Iterator[Row]:
    with bench(watchdog_ms=0) as made:
        made.master, silent_since = None, made.last_alive
        made.tick(400)
        made.clock = silent_since + WRAP_MS + 50
        yield "no master for 2^32 ms: the clock shows the same number", "clear", *asked(made, clear(made))
    with bench() as made:
        other = MasterAlive(LAMP | GATE | MOTION, 2, 7)
        yield "a second session", "cure", *under_way(made, lambda: made.send_keep_alive(other), CURE)
    with bench() as made:
        yield "a stop request", "pass", *under_way(made, lambda: made.stop(True))
    with bench() as made:
        stopped(made, True, False)
        yield "a stop request, and one frame that releases it", "clear", *asked(made, clear(made, 1))


def of_gates() -> Iterator[Row]:
    what = "both end switches of the gate true"
    with bench() as made:
        made.broken(CONTRADICTION)
        test = made.routine(Routine.SELF_TEST, option=b"\0\0")
        for name, request in (
            ("pass", made.routine(Routine.PASS, 1, option=PASS_REQUEST)),
            ("self test of the gate", test),
        ):
            yield what, f"{name}, asked", *asked(made, request)
        yield what, "cure, asked", *asked(made, made.routine(Routine.CURE, 1, option=CURE_REQUEST), CURE)
    for name, node in (("pass", HEAD), ("cure", CURE)):
        with bench() as made:
            yield what, name, *under_way(made, lambda: made.broken(CONTRADICTION), node)


def of_lamps() -> Iterator[Row]:
    with bench() as made:
        made.broken(Broken.LAMP_STAYS_OFF)
        yield "the lamp stays dark", "cure", *under_way(made, lambda: made.tick(LONG_MS), CURE)


def of_one_node() -> Iterator[Row]:
    what = "no motion enable, head and stage one node"
    with bench(one_node=True) as made:
        made.master = MasterAlive(LAMP | GATE, 1, 7)
        made.tick(100)
        yield what, "pass, asked", *asked(made, made.routine(Routine.PASS, 1, option=PASS_REQUEST))
    with bench(one_node=True) as made:
        yield what, "pass", *under_way(made, lambda: setattr(made, "master", MasterAlive(GATE, 1, 7)))
    with bench(one_node=True, passes=1) as made:
        assert made.ask(made.routine(Routine.PASS, 1, option=b"\xff"))[0] == 0x71
        what = "uncured ink, head and lamp one node"
        download = bytes.fromhex("34 00 44 00000002 00000020")
        yield what, "pattern of the next layer, asked", *asked(made, download)
        yield what, "scan, asked", *asked(made, made.routine(Routine.SCAN, 1))


def of_watchdogs() -> Iterator[Row]:
    for name, node in (("pass", HEAD), ("cure", CURE)):
        with bench() as made:
            yield "the firmware hangs", name, *under_way(made, lambda: hang(made), node)
    with bench() as made:
        made.c.probe_drive_gate(made.bench, HEAD)
        made.tick(400)
        yield "the node drives its gate without a step", "nothing", *words(made, b"", HEAD)


def clear(made: NodeBench, option: int = 0) -> bytes:
    return made.routine(Routine.CLEAR, option=bytes([option]))


def of_storage() -> Iterator[Row]:
    with bench() as made:
        made.broken(Broken.STORAGE_FULL)
        yield "what the pass has made cannot be kept", "pass", *under_way(made, lambda: made.tick(LONG_MS))


def rows() -> list[Row]:
    """The rows, each on nodes of its own."""
    return [*of_masters(), *of_gates(), *of_lamps(), *of_one_node(), *of_watchdogs(), *of_storage()]
