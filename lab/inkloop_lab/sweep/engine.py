"""Print what a plan asks for on an engine, and keep the records; what is recorded already is not printed again."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from inkloop_lab.sweep.journal import Journal
from inkloop_lab.sweep.plan import Plan
from inkloop_lab.sweep.task import INTERRUPTED, Record, Task

POLL_S = 0.25
"""Until Ctrl-C is seen."""


class Engine(Protocol):
    """Where tasks are performed."""

    @property
    def slots(self) -> int:
        """Tasks that may be submitted now."""
        ...

    def submit(self, task: Task) -> None:
        """Begin a task."""
        ...

    def completed(self, timeout_s: float) -> Sequence[Record]:
        """Records of the tasks that have ended since, after this time at the latest."""
        ...


def carry_out(
    plan: Plan,
    engine: Engine,
    journal: Journal,
    interrupted: Callable[[], bool],
    on_record: Callable[[Record], None],
) -> bool:
    """Print a whole plan; False if it was interrupted before its end. Raises InkloopError.

    on_record: called for every record of the plan, those of an earlier part of the study included.
    """
    first, further, running = plan.begin(), deque[Task](), 0
    while True:
        while not interrupted():
            if running and not engine.slots:
                break
            task = further.popleft() if further else next(first, None)
            if task is None:
                break
            known = journal.records.get(task.key)
            if known is None:
                engine.submit(task)
                running += 1
            else:
                further.extend(plan.after(known))
                on_record(known)
        if interrupted():
            return False
        if not running:
            return True
        for record in engine.completed(POLL_S):
            running -= 1
            if record.status == INTERRUPTED:
                return False
            journal.add(record)
            further.extend(plan.after(record))
            on_record(record)
