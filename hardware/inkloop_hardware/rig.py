"""The bench as the master holds it: one bus, four nodes, one heartbeat, shared by printer and profiler."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

from inkloop_hardware.bus_settings import BusSettings
from inkloop_hardware.link import Link
from inkloop_hardware.records import NodeStatus
from inkloop_hardware.vocabulary import Node


class Rig:
    """A bus with its nodes.

    Nothing is opened before the first `attach`, everything is closed at the last `detach`. A process of its own owns
    the adapter and says every 100 ms that the master lives, as long as this one says so: by `alive`, and by waiting in
    a link. Changes of nodes go to the logger "inkloop_hardware" as sentences.

    settings: the bus; folder: of a relative traffic log. To be used by one thread.
    """

    def __init__(self, settings: BusSettings, *, folder: Path | None = None) -> None:
        self.settings = settings
        self.folder = folder

    @property
    def session(self) -> int:
        """Number that this master took when it started, 1 to 65535."""
        raise NotImplementedError

    @property
    def job(self) -> int:
        """The print job, 1 to 2^32 - 1; random unless set. To be kept with the state of a run, so that a resumed one
        goes on with it. May be set at any time while nothing is enabled; ValueError for a number out of range."""
        raise NotImplementedError

    @job.setter
    def job(self, number: int) -> None:
        raise NotImplementedError

    def attach(self) -> None:
        """One more user; the first one opens the bus. BusError if it cannot be opened, which does not count."""
        raise NotImplementedError

    def detach(self) -> None:
        """One user less; with the last one enables drop, the heartbeat ends, the traffic log and the bus are closed.
        Does nothing without an `attach`, so it may stand in every clean-up."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self.attach()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.detach()

    def link(self, node: Node) -> Link:
        """What talks to one node; always the same object. To be used while attached."""
        raise NotImplementedError

    def alive(self) -> None:
        """Says that the control loop lives, and takes note of what the nodes said meanwhile.

        To be called at least every `settings.grace_s` while something is enabled (a waiting link does so), and once per
        do_step otherwise. BusError when the bus process ended, with its words.
        """
        raise NotImplementedError

    @contextmanager
    def enabled(self, *, lamp: bool = False, gate: bool = False, motion: bool = False) -> Iterator[None]:
        """Enables for one step; on leaving, whatever happened, nothing is enabled any more. Not to be nested."""
        raise NotImplementedError
        yield

    def wait_for(self, nodes: Iterable[Node], limit_s: float = 3.0) -> None:
        """Waits until every one of `nodes` is heard and believed; NodeLost that names those that are not."""
        raise NotImplementedError

    def check(self, nodes: Iterable[Node]) -> None:
        """NodeLost if one of them was never heard, is silent for three cycles (300 ms) or is not to be believed."""
        raise NotImplementedError

    def status(self, node: Node) -> NodeStatus | None:
        """The last intact status of a node; None: none yet."""
        raise NotImplementedError

    def age(self, node: Node) -> float | None:
        """Seconds since that status came in; None: none yet."""
        raise NotImplementedError

    def stop_request(self, active: bool = True) -> None:
        """Asks all nodes to take their de-energised state and to stay in it, every 50 ms until called with False.
        Afterwards a person must clear them. No emergency stop."""
        raise NotImplementedError
