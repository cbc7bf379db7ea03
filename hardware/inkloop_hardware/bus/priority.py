"""Scheduling priority of the bus process: a busy machine must not delay the heartbeat, for the nodes then go off.

python -m inkloop_hardware.bus.priority     prints what this user is granted
"""

from __future__ import annotations

import os

NICE = -10
"""Nice value requested if real-time scheduling is not granted; the default of a program is 0."""
NONE = "no priority"
"""Beginning of the answer if nothing was granted."""


def raise_priority() -> str:
    """Request real-time scheduling for this process, else a lower nice value; returns the priority granted, or the
    reason why none was.

    To be called before threads start, which inherit it.
    """
    if not hasattr(os, "sched_setscheduler"):
        return f"{NONE}: this system has no real-time scheduling that Python can ask for"
    try:  # the lowest real-time priority is above every ordinary program, and below drivers and audio
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
        return "real-time priority"
    except OSError as error:
        refused = error.strerror
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
        return f"nice {NICE}; real-time priority: {refused}"
    except OSError as error:
        return f"{NONE}: {error.strerror}"


if __name__ == "__main__":
    print(raise_priority())
