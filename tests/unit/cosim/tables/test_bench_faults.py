"""Faults of the emulator, as text and as tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from inkloop.bench.emulation import emulation_of
from inkloop.errors import InkloopError, ScenarioError
from inkloop.scenario.file import Scenario
from inkloop.tables.bench_faults import read_fault
from support.benches.bench_run import BLOCK, write


@pytest.mark.parametrize(
    "text", ["loss:probability=0.001,way=to-nodes,seed=3", "reboot:nth=4,node=head,layer=2,pass=1,step=pass", "bus-off"]
)
def test_fault_is_written_as_it_is_read(text: str) -> None:
    assert str(read_fault(text)) == text
    assert str(read_fault("corruption:id=0x640")) == "corruption:id=1600"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lost", "kind is 'lost'; expected 'loss'"),
        ("loss:p=1", "p is not a key of this table"),
        ("loss:psas=1", "did you mean pass"),
        ("loss:probability=2,way=up", r"probability is 2;.*way is 'up'; expected 'to-nodes' or 'from-nodes'"),
        ("loss:probability=0.5,nth=1", "expected probability, or nth, not both"),
        ("death", "needs node as well"),
        ("hang", "needs node as well"),
        ("slow-erase:frames=3", "needs node as well"),
        ("unreadable", "needs node as well"),
        ("unreadable:node=head,count=0", "count is 0"),
        ("short-queue:frames=0", "frames is 0"),
        ("transmit-order:node=hed", "expected .head., .stage."),
        ("broken:node=head", "needs part as well"),
    ],
)
def test_wrong_fault_is_refused_with_a_message(text: str, message: str) -> None:
    with pytest.raises(InkloopError, match=message):
        read_fault(text)


def test_scenario_lists_the_faults_and_all_its_errors_are_reported_at_once(tmp_path: Path) -> None:
    tables = '\n[[bench.faults]]\nkind = "death"\nnode = "cure"\nstep = "cure"\n[[bench.faults]]\nkind = "swap"\n'
    found = emulation_of(Scenario.load(write(tmp_path, BLOCK + tables))).faults
    assert [str(fault) for fault in found] == ["death:node=cure,step=cure", "swap"]
    wrong = tables.replace('"swap"', '"swop"').replace('"cure"', '"lamp"')
    with pytest.raises(ScenarioError) as raised:
        Scenario.load(write(tmp_path, BLOCK + wrong))
    for word in ("bench.faults.[0].node", "bench.faults.[0].step", "bench.faults.[1].kind is 'swop'"):
        assert word in str(raised.value)
