"""The interface of a component kind: options are checked once, which yields ports and a factory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from inkloop.component import Component, Job, Ports
from inkloop.components.bench import Bench
from inkloop.errors import ScenarioError


@dataclass(frozen=True)
class Checked:
    """The checked options of one component. errors: one sentence each, beginning with the key; ports: None with errors.

    construct: makes a component from the options.
    """

    kind: str
    errors: Sequence[str] = ()
    ports: Ports | None = None
    construct: Callable[[Bench], Component] | None = None

    def make(self, bench: Bench) -> Component:
        """A component, for the caller to terminate; bench: of all devices of its loop.

        Raises ScenarioError with the errors, FmuError.
        """
        if self.errors or self.construct is None:
            raise ScenarioError(self.kind, self.errors)
        return self.construct(bench)


Check: TypeAlias = Callable[[str, Job, Mapping[str, object]], Checked]
"""`catalog.check`, handed to kinds that contain a component of another kind."""


class Kind(Protocol):
    """A kind of component. path_option: its option that names a file or folder relative to the scenario, if any."""

    @property
    def path_option(self) -> str | None: ...

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check options for a job; opens no bus and starts no FMU. Raises FmuError where an FMU cannot be read."""
