"""Ctrl-C that waits for the end of a communication step, so that nothing recorded is half written; and advice."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["advised", "deferred"]


class _Ask:
    """Notes the first Ctrl-C, also for the enclosing blocks, and leaves the next one to the earlier handler."""

    def __init__(self, before: Any) -> None:
        self.asked = threading.Event()
        self.before = before

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.asked.set()
        if isinstance(self.before, _Ask):
            self.before(number, frame)
        else:
            signal.signal(signal.SIGINT, self.before)


@contextmanager
def deferred() -> Iterator[Callable[[], bool]]:
    """Within the block the first Ctrl-C only makes the yielded function true; the second one interrupts at once.

    Blocks may be nested: the outermost one serves all.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # Python lets only the main thread handle signals
        return
    ask = _Ask(signal.getsignal(signal.SIGINT))
    signal.signal(signal.SIGINT, ask)
    try:
        yield ask.asked.is_set
    finally:
        if not ask.asked.is_set():
            signal.signal(signal.SIGINT, ask.before)


@contextmanager
def advised(advice: Callable[[], str]) -> Iterator[None]:
    """A block that Ctrl-C ends at once with advice, which the command shows."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(advice())
        raise
