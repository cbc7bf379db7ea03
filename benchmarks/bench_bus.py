"""BenchBus.fmu: how much faster than the clock it runs, and what a frame on its bus costs."""

from __future__ import annotations

from rich.table import Table

from benchmarks.timing import least, scaled, table_of
from inkloop.fmu.bus import BusNode
from inkloop.fmu_writer.export import find_fmu
from inkloop.units import NS_PER_S

SECONDS, ROUNDS = 5, 3
STEPS_NS = (1_000_000, 10_000_000)
TESTER_PRESENT = (0x640, bytes.fromhex("023e00cccccccccc"), False, False)


def measure() -> Table:
    """Processor time of one core, least of some, of SECONDS on the bus, silent and with a request in each step."""
    table = table_of(
        "BenchBus.fmu on a bus, processor time of one core, least of some",
        ("step", "of 1 s, silent", "faster than the clock", "of a request and its answer"),
    )
    for step_ns in STEPS_NS:
        silent, busy = (_least(step_ns, asks) for asks in (False, True))
        frame = (busy - silent) / (SECONDS * NS_PER_S / step_ns)
        times = f"{SECONDS / silent:.0f} times"
        table.add_row(scaled(step_ns / NS_PER_S), scaled(silent / SECONDS), times, scaled(max(0.0, frame)))
    return table


def _least(step_ns: int, asks: bool) -> float:
    node = BusNode(find_fmu("BenchBus"), {})
    now_ns = 0

    def run() -> None:
        nonlocal now_ns
        for _ in range(SECONDS * NS_PER_S // step_ns):
            node.step(now_ns, step_ns, [TESTER_PRESENT] if asks else [])
            now_ns += step_ns

    try:
        return least(run, ROUNDS)
    finally:
        node.close()
