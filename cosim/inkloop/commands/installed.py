"""Commands of other packages: entry points of the group "inkloop.commands", see `inkloop.commands`."""

from __future__ import annotations

import sys
from collections.abc import Container, Iterator
from importlib.metadata import entry_points
from types import ModuleType

from inkloop.errors import InkloopError, message_of

GROUP = "inkloop.commands"


def commands(word: str, taken: Container[str]) -> Iterator[ModuleType]:
    """The modules of the installed commands; only that of `word` where it names one.

    taken: names of inkloop's own commands, which no package replaces. A module that cannot be loaded is left out with a
    message; raises InkloopError where `word` names it.
    """
    found = {point.name: point for point in entry_points(group=GROUP) if point.name not in taken}
    for name in [word] if word in found else sorted(found):
        try:
            yield found[name].load()
        except Exception as error:  # anything may go wrong in a package of others
            package = found[name].dist
            reason = f"the command {name} of {package.name if package else 'a package'} cannot be loaded"
            failure = InkloopError(f"{reason}: {message_of(error)}; update or uninstall that package")
            if name == word:
                raise failure from error
            print(f"inkloop: {failure}", file=sys.stderr)
