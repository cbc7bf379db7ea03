"""Real time: the loop waits for the clock at its communication points, and keeps account of its deadlines."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Mapping

import numpy as np

from inkloop.units import MS_PER_S, S_PER_NS

LONGEST_SLEEP_NS = 100_000_000  # so that Ctrl-C is noticed during a long wait


class Pacing:
    """Holds communication point t until t / factor seconds of the clock after the start; a late one continues at once.

    Points are due by the start, not by each other: after a late one the loop catches up. clock: monotonic time [ns];
    sleep: waits that many seconds.
    """

    def __init__(
        self,
        factor: float = 1.0,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._factor = factor
        self._clock = clock
        self._sleep = sleep
        self._begin_ns = 0
        self._lateness_ns = array("q")

    def start(self, time_ns: int) -> None:
        """The clock runs, and the loop stands at `time_ns`."""
        self._begin_ns = self._clock() - round(time_ns / self._factor)

    def wait(self, time_ns: int, is_cancelled: Callable[[], bool] = lambda: False) -> None:
        """Return when `time_ns` is due, or soon after `is_cancelled` is true; note how late the loop came here."""
        due_ns = self._begin_ns + round(time_ns / self._factor)
        self._lateness_ns.append(max(0, self._clock() - due_ns))
        while (left_ns := due_ns - self._clock()) > 0 and not is_cancelled():
            self._sleep(min(left_ns, LONGEST_SLEEP_NS) * S_PER_NS)

    @property
    def statistics(self) -> dict[str, float]:
        """Communication points, late ones, and their delay: worst and 99th percentile [s]."""
        lateness = np.array(self._lateness_ns, dtype=np.int64)
        figures = {"real_time_factor": self._factor, "steps": lateness.size, "missed": int(np.count_nonzero(lateness))}
        worst, p99 = (lateness.max(), np.percentile(lateness, 99)) if lateness.size else (0, 0.0)
        return figures | {"worst_s": float(worst) * S_PER_NS, "p99_s": float(p99) * S_PER_NS}


def sentence(statistics: Mapping[str, float]) -> str:
    """The statistics of a run as one line."""
    return (
        f"real time x {statistics['real_time_factor']:g}: {statistics['missed']} of {statistics['steps']} steps late, "
        f"worst {statistics['worst_s'] * MS_PER_S:.3g} ms, 99 % within {statistics['p99_s'] * MS_PER_S:.3g} ms"
    )
