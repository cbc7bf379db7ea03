"""Those that a master works with besides components: who watches a run, who guides it, and where it resumes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, TypeAlias

from inkloop.component import Values

__all__ = ["StopReason"]

StopReason: TypeAlias = str
""""time_max", "interrupted", or a reason of the course."""


class Observer(Protocol):
    """Watches the run. The arrays are read-only views of what components gave; an observer copies what it keeps."""

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """All components are ready; `outputs` are those of the start time, by component."""

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """A communication point has been reached."""


class Course(Protocol):
    """Knows what the run is for: it changes values on their way between components, and decides about the end."""

    @property
    def endless(self) -> str:
        """The reason why only the clock ends the run, empty if the course does."""

    def begin(self, outputs: Mapping[str, Values]) -> None:
        """The run starts with these outputs, or is resumed from them."""

    def inputs(self, name: str, values: Values, time_ns: int, outputs: Mapping[str, Values]) -> Values:
        """The inputs of a component in a step that begins at `time_ns`, in place of `values`."""

    def outputs(self, name: str, values: Values, time_ns: int, outputs: Mapping[str, Values]) -> Values:
        """The outputs of a component after a step that began at `time_ns`, in place of `values`."""

    def end(self, outputs: Mapping[str, Values]) -> StopReason | None:
        """The reason why the run ends here, None if it does not."""

    def place(self, outputs: Mapping[str, Values]) -> str:
        """Where the run is, for a message; may be empty."""


class SavedPoint(Protocol):
    """A communication point to resume from: `outputs` of all components as the others see them, `states` as saved."""

    @property
    def time_ns(self) -> int: ...

    @property
    def outputs(self) -> Mapping[str, Values]: ...

    @property
    def states(self) -> Mapping[str, bytes]: ...
