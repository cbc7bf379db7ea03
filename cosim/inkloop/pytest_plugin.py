"""pytest plug-in: the laws of `inkloop.testing` for components that are named on the command line.

    pytest -p inkloop.pytest_plugin --inkloop-component threshold:Threshold

Each law becomes a test item of its own, beside whatever else pytest collects.
"""

from __future__ import annotations

import pytest

from inkloop import catalog
from inkloop.testing import LAWS, RESUMABLE_LAWS, job


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds `--inkloop-component`."""
    parser.getgroup("inkloop").addoption(
        "--inkloop-component",
        action="append",
        default=[],
        metavar="KIND",
        help="a kind of component, e.g. package.module:Class, that shall keep the laws of inkloop.testing",
    )


def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    """Adds an item for each law and each component named."""
    items += [
        LawItem.from_parent(session, name=f"{kind}::{law.__name__}", kind=kind, number=number)
        for kind in config.getoption("--inkloop-component")
        for number, law in enumerate(RESUMABLE_LAWS)
    ]


class LawItem(pytest.Item):
    """One law for one component; that of `save` and `restore` is skipped where a component offers neither."""

    def __init__(self, *, kind: str, number: int, **parent: object) -> None:
        super().__init__(**parent)  # type: ignore[arg-type]  # pytest hands its own keywords through
        self._kind, self._number = kind, number

    def runtest(self) -> None:
        """Raises AssertionError in words where the law is broken."""
        law = RESUMABLE_LAWS[self._number]
        if law not in LAWS and not hasattr(catalog.make(self._kind, job(), {}), "save"):
            pytest.skip(f"{self._kind} has no save: a run with it cannot be resumed")
        law(lambda: catalog.make(self._kind, job(), {}))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None) -> str:
        """What is wrong, without a traceback through the suite."""
        return f"{self._kind} breaks a law: {self.name.rpartition('::')[2].replace('_', ' ')}\n{excinfo.value}"

    def reportinfo(self) -> tuple[str, None, str]:
        """Where and what, for the report."""
        return self._kind, None, self.name
