"""SocketCAN of a real kernel: user-mode Linux runs the checks of `support.benches.socketcan_checks`."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from support.benches import socketcan_checks, uml_guest

pytestmark = [pytest.mark.compiled, pytest.mark.long]
LIMIT_S = 900.0
NAMES = [name for name in vars(socketcan_checks) if name.startswith("test_")]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, ElementTree.Element]:
    """The report of each check; without a part if it passed."""
    if missing := uml_guest.missing_programs():
        pytest.skip(f"{', '.join(missing)} not installed: make tools")
    folder = tmp_path_factory.mktemp("guest")
    report = folder / "report.xml"
    command = [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider", f"--basetemp={folder / 'tests'}"]
    command += [f"--junit-xml={report}", str(socketcan_checks.__file__)]
    code, console = uml_guest.run_in_guest(command, folder, ROOT, sys.executable, LIMIT_S)
    assert report.exists(), f"exit code {code}\n{console}"
    cases = ElementTree.parse(report).iter("testcase")
    return {str(case.get("name")): case for case in cases}


@pytest.mark.parametrize("name", NAMES)
def test_socketcan(name: str, outcomes: dict[str, ElementTree.Element]) -> None:
    case = outcomes[name]
    if (skipped := case.find("skipped")) is not None:
        pytest.skip(str(skipped.get("message")))
    assert not list(case), "\n".join(part.text or "" for part in case)
