"""The doctor of a bench: findings in a table, a verdict, and the bus of the scenario."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop.bench import doctor
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop_hardware.doctor.findings import Finding
from support.benches.bench_run import FMUS, write


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        (0, "ready to print"),
        (1, "1 error: correct it before a print"),
        (2, "2 errors: correct them before a print"),
    ],
)
def test_verdict_counts_the_errors(errors: int, words: str) -> None:
    assert doctor._verdict(errors) == words


def test_name_of_a_check_stands_at_the_first_of_its_findings() -> None:
    """Also where the last finding of all is one of the same check."""
    found = [
        Finding.ok("bus", "is there"),
        Finding.warning("bus", "is slow", "shorten it"),
        Finding.error("node", "is silent", "power it"),
        Finding.ok("bus", "is quiet"),
    ]
    stream = io.StringIO()
    Terminal(stream, width=80).print(doctor._table(found))
    rows = [line.replace("│", "").split() for line in stream.getvalue().splitlines()[2:]]
    assert rows == [
        ["bus", "ok", "is", "there"],
        ["warning", "is", "slow", "shorten", "it"],
        ["node", "error", "is", "silent", "power", "it"],
        ["bus", "ok", "is", "quiet"],
    ]


@pytest.mark.parametrize(
    ("overrides", "grade", "words"),
    [
        ({"bench.channel": "can0"}, "ok", ": slcan on can0"),
        ({}, "warning", ": bench.channel not set"),
        ({"bench.interface": "virtual", "bench.channel": 0}, "ok", ": virtual on 0"),
        (FMUS, "warning", "no component of "),
    ],
)
def test_bus_of_a_scenario_is_a_finding(overrides: Mapping[str, Any], grade: str, words: str, tmp_path: Path) -> None:
    (finding,) = doctor._of_scenario(Scenario.load(write(tmp_path), overrides))
    assert (finding.check, str(finding.grade)) == ("scenario", grade)
    assert words in finding.found
    assert list(doctor._of_scenario(None)) == []


def scenario(*kinds: str) -> Any:
    """One with components of these kinds."""
    components = {f"part{number}": SimpleNamespace(kind=kind) for number, kind in enumerate(kinds)}
    bench = SimpleNamespace(interface="slcan", channel="can0")
    return SimpleNamespace(tables=SimpleNamespace(components=components, bench=bench), source="rig.toml")


def test_mapping_is_examined_where_it_has_all_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "mapping_of", lambda scenario, name: f"mapping of {name}")
    assert doctor._mapping(scenario("LayerMpc", "hardware.mapped")) == "mapping of part1"
    assert doctor._mapping(scenario("hardware.mapped", "hardware.profiler")) is None
    assert doctor._mapping(scenario("LayerMpc")) is None
    assert doctor._mapping(None) is None
    (finding,) = doctor._of_scenario(scenario("LayerMpc", "hardware.mapped"))
    assert finding.found == "rig.toml: slcan on can0"


@pytest.mark.parametrize(
    ("answer", "agreed"), [("y\n", True), (" YES \n", True), ("\n", False), ("", False), ("yep\n", False)]
)
def test_only_a_yes_is_one(answer: str, agreed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    assert doctor._agreed("the lamp") is agreed


def examined(
    monkeypatch: pytest.MonkeyPatch, *found: Finding, self_test: bool = False, yes: bool = False
) -> tuple[int, bool]:
    """The exit code for these findings, and whether a self test was asked for; none is confirmed."""
    asked: list[bool] = []

    def examine(*_: object, self_test: bool, mapping: object) -> list[Finding]:
        asked.append(self_test)
        return list(found)

    monkeypatch.setattr("inkloop_hardware.doctor.doctor.examine", examine)
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    options: Any = SimpleNamespace(self_test=self_test, yes=yes)
    code = doctor.examine(None, options, Terminal(quiet=True))
    return code, asked[0]


def test_errors_alone_make_the_exit_code_and_a_self_test_needs_a_yes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert examined(monkeypatch, Finding.ok("bus", "is there"), Finding.warning("bus", "is slow")) == (0, False)
    assert examined(monkeypatch, Finding.error("node", "is silent", "power it")) == (1, False)
    assert examined(monkeypatch, yes=True) == (0, False)
    assert examined(monkeypatch, self_test=True) == (0, False)
    assert examined(monkeypatch, self_test=True, yes=True) == (0, True)
