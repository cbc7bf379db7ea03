"""What is required by what, among the packages of this environment."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from inkloop.errors import InkloopError


def closure(
    requirements: Iterable[str], *, transitive: bool = True
) -> tuple[dict[str, Distribution], dict[str, set[str]]]:
    """Name -> distribution of all that is required on this machine, and name -> names of what it needs ("": the list).

    Raises InkloopError for what is not installed.
    """
    found: dict[str, Distribution] = {}
    needs: dict[str, set[str]] = {"": set()}
    seen: set[tuple[str, str]] = set()
    missing = set()
    waiting = [("", "", Requirement(text)) for text in requirements]
    while waiting:
        by, extra, requirement = waiting.pop()
        if requirement.marker and not requirement.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(requirement.name)
        needs.setdefault(by, set()).add(name)
        needs.setdefault(name, set())
        try:
            found.setdefault(name, distribution(requirement.name))
        except PackageNotFoundError:
            missing.add(name)
            continue
        for wanted in ("", *sorted(requirement.extras)) if transitive else ():
            if (name, wanted) not in seen:
                seen.add((name, wanted))
                waiting += [(name, wanted, Requirement(text)) for text in found[name].requires or []]
    if missing:
        names = ", ".join(sorted(missing))
        raise InkloopError(f"inkloop requires {names}, which this environment lacks: make .venv/developer")
    return dict(sorted(found.items())), needs
