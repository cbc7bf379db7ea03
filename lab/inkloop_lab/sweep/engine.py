"""Print what a plan asks for and keep the records; what the folder holds already is not printed again.

One loop for all places: processes of this machine and the workers of a cluster are executors of `concurrent.futures`.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass

from inkloop.errors import InkloopError, message_of
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.plan import Plan
from inkloop_lab.sweep.task import INTERRUPTED, Record, Task, failed, name_of

POLL_S = 0.25
"""Until Ctrl-C is seen."""
DEATHS_MAX = 3
"""Deaths of its process (on a cluster: times that the scheduler gives it up) after which a print has failed."""


@dataclass(frozen=True)
class Site:
    """Where prints are made.

    work: prints a task there; slots: tasks that it takes at a time, now; death: error of a task whose process has died.
    """

    executor: Executor
    work: Callable[[Task], Record]
    slots: Callable[[], int]
    death: type[Exception]


def carry_out(
    plan: Plan,
    site: Site,
    folder: StudyFolder,
    interrupted: Callable[[], bool],
    on_record: Callable[[Record], None],
) -> bool:
    """Print a whole plan; False if it was interrupted before its end. Raises InkloopError.

    on_record: called for every record of the plan, those of an earlier part of the study included.
    """
    first, further = plan.begin(), deque[Task]()
    running: dict[Future[Record], Task] = {}
    deaths = Counter[tuple[int, int]]()
    while not interrupted():
        while len(running) < site.slots() and (task := further.popleft() if further else next(first, None)):
            if (known := folder.records.get(task.key)) is None:
                running[site.executor.submit(site.work, task)] = task
            else:
                further.extend(plan.after(known))
                on_record(known)
        if not running:
            return True
        for future in wait(running, POLL_S, FIRST_COMPLETED).done:
            task = running.pop(future)
            record = _record(future, task, site, deaths)
            if record is None:
                further.appendleft(task)
            elif record.status == INTERRUPTED:
                return False
            else:
                folder.add(record)
                further.extend(plan.after(record))
                on_record(record)
    return False


def _record(future: Future[Record], task: Task, site: Site, deaths: Counter[tuple[int, int]]) -> Record | None:
    """The record of a task that has ended, None where it is to be printed again. Raises InkloopError."""
    try:
        return future.result()
    except site.death:
        deaths[task.key] += 1
        if deaths[task.key] < DEATHS_MAX:
            return None
        cause = "native code crashes, or the memory is exhausted (then --workers 1)"
        return failed(task, f"its process died {DEATHS_MAX} times: {cause}")
    except CancelledError as error:
        raise InkloopError("the scheduler of the cluster is gone, or has cancelled the prints") from error
    except InkloopError:
        raise
    except Exception as error:  # a connection that is lost, a worker without inkloop
        raise InkloopError(f"print {name_of(task.key)}: {message_of(error)}") from error
