"""Layers of a mapped rig in the journal of the run: what is printed, and what a person is asked about."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop_hardware.devices.master_journal import Asked, Event, JournalError, MasterJournal
from inkloop_hardware.mapped.mapped_layer import LayerIsOpen, MappedLayer, newest_layer, outcome_of, settle
from inkloop_hardware.mapped.mapping_tables import Download, Send, Wait
from inkloop_hardware.protocol.services import Key

JOB, CRC = 7, 0xABCD
STEPS = (
    Download(do="download", peer="head"),
    Send(do="send", message="PlcCommand"),
    Wait(do="wait", message="PlcState", signal="State", expected="READY"),
)
RIG: Any = SimpleNamespace(is_open=False, job=JOB, session=3)


def journal(folder: Path | None = None) -> MasterJournal:
    found = MasterJournal(folder)
    found.begin(RIG)
    return found


def begin(of: MasterJournal, layer: int, last_step: int) -> None:
    for number in range(1, last_step + 1):
        of.intend(Asked.STEP, Key(JOB, layer, number), CRC)
        of.done(Asked.STEP, Key(JOB, layer, number), CRC)


def test_layer_is_printed_that_no_step_was_begun_of() -> None:
    of = journal()
    assert outcome_of(1, CRC, newest_layer(of), STEPS) is None
    begin(of, 1, 2)
    of.done(Asked.LAYER, Key(JOB, 1), CRC)
    assert outcome_of(2, CRC, newest_layer(of), STEPS) is None


def test_open_layer_asks_a_person_wherever_it_ended(tmp_path: Path) -> None:
    """Also if the last step was confirmed: what the rig has done since is not known."""
    of = journal(tmp_path)
    of.intend(Asked.STEP, Key(JOB, 1, 1), CRC)
    with pytest.raises(LayerIsOpen, match=r"the last step begun is 1 of 3 \(download head\)\. .*--layer-is printed"):
        outcome_of(1, CRC, newest_layer(of), STEPS)
    begin(of, 1, 2)
    with pytest.raises(LayerIsOpen, match=r"the last step begun is 2 of 3 \(send PlcCommand\)"):
        outcome_of(1, CRC, newest_layer(MasterJournal(tmp_path)), STEPS)


@pytest.mark.parametrize(("seen", "outcome"), [("printed", Event.PRINTED), ("blank", None), ("unknown", Event.UNKNOWN)])
def test_person_says_what_became_of_it(seen: str, outcome: Event | None, tmp_path: Path) -> None:
    begin(journal(tmp_path), 1, 2)
    settle(tmp_path, seen)
    assert outcome_of(1, CRC, newest_layer(MasterJournal(tmp_path)), STEPS) is outcome
    with pytest.raises(JournalError, match="no layer is open"):
        settle(tmp_path, seen)


def test_layer_that_is_printed_again_and_cut_short_is_open_again() -> None:
    of = journal()
    begin(of, 1, 2)
    of.settle(Event.BLANK, Key(JOB, 1), CRC)
    of.intend(Asked.STEP, Key(JOB, 1, 1), CRC)
    assert newest_layer(of) == MappedLayer(1, 1, Event.INTENT, CRC)
    with pytest.raises(LayerIsOpen):
        outcome_of(1, CRC, newest_layer(of), STEPS)


def test_printed_layer_of_another_pattern_is_refused() -> None:
    of = journal()
    begin(of, 1, 2)
    of.done(Asked.LAYER, Key(JOB, 1), CRC)
    assert outcome_of(1, CRC, newest_layer(of), STEPS) is Event.DONE
    with pytest.raises(LayerIsOpen, match="another pattern"):
        outcome_of(1, CRC + 1, newest_layer(of), STEPS)


def test_layer_that_the_run_has_left_behind_is_refused() -> None:
    of = journal()
    begin(of, 2, 1)
    with pytest.raises(LayerIsOpen, match="layer 1 is due, but this run has begun layer 2"):
        outcome_of(1, CRC, newest_layer(of), STEPS)


def test_layer_of_another_job_is_not_looked_at() -> None:
    of = journal()
    begin(of, 1, 2)
    assert newest_layer(of) is not None
    of._append(Event.OPENED, Asked.NOTHING, Key(JOB + 1, 0), 0, 4)
    assert newest_layer(of) is None


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (0, r"0 of 3\."),
        (1, r"1 of 3 \(download head\)\."),
        (2, r"2 of 3 \(send PlcCommand\)\."),
        (3, r"3 of 3 \(wait\)\."),
        (4, r"4 of 3\."),
    ],
)
def test_last_step_is_named_if_the_mapping_still_has_it(step: int, words: str) -> None:
    with pytest.raises(LayerIsOpen, match=f"layer 1 was begun and not finished: the last step begun is {words}"):
        outcome_of(1, CRC, MappedLayer(1, step, Event.INTENT, CRC), STEPS)


def test_end_of_a_layer_keeps_the_number_of_its_last_step() -> None:
    of = journal()
    begin(of, 1, 2)
    of.done(Asked.LAYER, Key(JOB, 1), CRC)
    assert newest_layer(of) == MappedLayer(1, 2, Event.DONE, CRC)
    of.intend(Asked.STEP, Key(JOB, 2, 1), CRC + 1)
    assert newest_layer(of) == MappedLayer(2, 1, Event.INTENT, CRC + 1)
