"""The master's journal: on the disk before anything is asked for, whole after any end, and no word against the head."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock as Mock

import numpy as np
import pytest

from inkloop.files import open_own
from inkloop_hardware.devices import master_journal
from inkloop_hardware.devices.commands import clear_all
from inkloop_hardware.devices.journal_comparison import JournalsDiffer, compare
from inkloop_hardware.devices.master_journal import JOURNAL_FILE, Asked, Event, JournalError, LayerAsked, MasterJournal
from inkloop_hardware.devices.printer import Printer
from inkloop_hardware.devices.profiler import Profiler
from inkloop_hardware.devices.readiness import NotReady
from inkloop_hardware.protocol.node_state import Flags, NodeState
from inkloop_hardware.protocol.records import Node, State
from inkloop_hardware.protocol.services import Key, Routine
from support.benches.node_rig import FOUR, NodeRig, bench, print_layer
from support.benches.node_status import node_state

JOB = 7
STEPS = {Routine.PASS: Asked.PASS, Routine.CURE: Asked.CURE, Routine.SCAN: Asked.SCAN}


def journal(folder: Path) -> MasterJournal:
    """Of a layer in the middle: its first pass done, its second one asked for."""
    written = MasterJournal(folder)
    for layer in (1, 2):
        written.intend(Asked.PATTERN, Key(JOB, layer), 0xABC0 + layer)
        written.done(Asked.PATTERN, Key(JOB, layer), 0xABC0 + layer)
        written.intend(Asked.PASS, Key(JOB, layer, 0), 0xABC0 + layer)
        written.done(Asked.PASS, Key(JOB, layer, 0), 0xABC0 + layer)
    written.intend(Asked.PASS, Key(JOB, 2, 1), 0xABC2)
    return written


def test_another_process_reads_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder is synced, so that a new journal is there after a power failure."""
    synced = Mock()
    monkeypatch.setattr("inkloop_hardware.devices.master_journal.sync_folder", synced)
    new = MasterJournal(tmp_path)
    assert (new.job, new.session, new.layer, new.records) == (None, None, None, ())
    assert not (tmp_path / JOURNAL_FILE).exists()
    written, found = journal(tmp_path), MasterJournal(tmp_path)
    synced.assert_called_once_with(tmp_path)
    assert found.records == written.records
    assert (found.job, found.layer) == (JOB, LayerAsked(2, asked=0b11, done=0b01, pattern_crc=0xABC2))


def test_each_master_is_recorded_with_its_session_and_goes_on_with_the_job(tmp_path: Path) -> None:
    sessions = (3, 5)
    for session in sessions:
        rig: Any = SimpleNamespace(is_open=False, job=JOB if session == 3 else JOB + 1, session=session)
        kept = MasterJournal(tmp_path)
        kept.begin(rig)
        kept.intend(Asked.PATTERN, Key(rig.job, 1))
        assert (rig.job, kept.job, kept.session) == (JOB, JOB, session)
    rig.is_open = True
    kept.begin(rig)
    found = MasterJournal(tmp_path)
    assert [record.session for record in found.records] == [3, 3, 5, 5]
    assert found.session == 5


def test_saved_state_whose_journal_is_gone_is_refused(tmp_path: Path) -> None:
    """Without a folder there is none to compare with."""
    rig: Any = SimpleNamespace(is_open=False, job=1, session=3)
    with pytest.raises(JournalError, match=r"is the journal of job None, expected job 7 of the run: was it removed"):
        MasterJournal(tmp_path).resume(rig, JOB)
    MasterJournal().resume(rig, JOB)
    assert rig.job == JOB


def test_line_that_was_cut_short_anywhere_was_never_written(tmp_path: Path) -> None:
    """Nor one of garbage: a disk may have made room for a line and not written it."""
    records = journal(tmp_path).records
    path = tmp_path / JOURNAL_FILE
    whole = path.read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    for end in range(last, len(whole)):
        path.write_bytes(whole[:end])
        found = MasterJournal(tmp_path)
        assert (found.records, path.read_bytes()) == (records[:-1], whole[:last])
        found.intend(Asked.CURE, Key(JOB, 2, 0))
        assert MasterJournal(tmp_path).records[-1].asked is Asked.CURE
    for garbage in (b"\0" * 90, b"\0" * 90 + b"\n"):
        path.write_bytes(whole + garbage)
        assert (MasterJournal(tmp_path).records, path.read_bytes()) == (records, whole)


def test_journal_that_was_altered_in_the_middle_is_refused_with_a_message(tmp_path: Path) -> None:
    journal(tmp_path)
    path = tmp_path / JOURNAL_FILE
    lines = path.read_bytes().splitlines(keepends=True)
    for altered in (lines[:3] + lines[4:], [lines[0].replace(b"intent", b"done"), *lines[1:]]):
        path.write_bytes(b"".join(altered))
        with pytest.raises(JournalError, match=r"master\.journal: was altered.*begin a new part"):
            MasterJournal(tmp_path).records  # noqa: B018


@pytest.mark.parametrize("writes", ["all and cannot sync", "half, and reports no error"])
def test_full_disk_is_reported_and_leaves_the_journal_whole(
    writes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = journal(tmp_path)
    before = (tmp_path / JOURNAL_FILE).read_bytes()

    def half(path: Path, *words: Any, **options: Any) -> Any:
        file = open_own(path, *words, **options)
        taken = Mock(wraps=file, write=lambda line: file.write(line[: len(line) // 2]))
        taken.__enter__, taken.__exit__ = Mock(return_value=taken), Mock(side_effect=lambda *_: file.close())
        return taken

    with monkeypatch.context() as patch:
        if writes.startswith("half"):
            patch.setattr(master_journal, "open_own", half)
        else:
            patch.setattr(os, "fsync", Mock(side_effect=OSError(errno.ENOSPC, "no room")))
        with pytest.raises(JournalError, match=r"(no room|the disk is full).*its step was not requested"):
            written.intend(Asked.PASS, Key(JOB, 2, 2))
    assert (tmp_path / JOURNAL_FILE).read_bytes() == before
    written.intend(Asked.PASS, Key(JOB, 2, 2))
    assert MasterJournal(tmp_path).layer == LayerAsked(2, asked=0b111, done=0b01, pattern_crc=0)


@pytest.mark.parametrize("other", ["records", "nothing", "pipe"])
def test_link_or_pipe_in_the_place_of_the_journal_is_neither_followed_nor_awaited(other: str, tmp_path: Path) -> None:
    """Others could choose which file is read, cut off or appended to."""
    (tmp_path / "other").mkdir()
    (tmp_path / "run").mkdir()
    journal(tmp_path / "other")
    target, path = tmp_path / "other" / JOURNAL_FILE, tmp_path / "run" / JOURNAL_FILE
    before = target.read_bytes()
    if other == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(target if other == "records" else tmp_path / "nothing")
    with pytest.raises(
        JournalError, match=r"master\.journal: cannot be (read|written): (a link lies there|No such dev)"
    ):
        MasterJournal(tmp_path / "run").intend(Asked.PASS, Key(JOB, 1))
    assert target.read_bytes() == before
    assert not (tmp_path / "nothing").exists()


def test_newest_layer_is_that_of_patterns_and_passes_of_its_job(tmp_path: Path) -> None:
    """A lamp is asked for a layer that the head has given up, too."""
    written = journal(tmp_path)
    known = written.layer
    for asked in (Asked.CURE, Asked.SCAN):
        written.intend(asked, Key(JOB, 3, 1), 0x1234)
        written.done(asked, Key(JOB, 3, 1), 0x1234)
    assert written.layer == known
    written.intend(Asked.PATTERN, Key(JOB + 1, 2), 0x5678)
    assert written.layer == LayerAsked(2, pattern_crc=0x5678)


def journalled(routine: Routine, key: Key, *_: object) -> tuple[Asked, Key] | None:
    return (STEPS[routine], key) if routine in STEPS else None


@pytest.mark.compiled
def test_every_step_is_on_the_disk_before_it_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Content of the disk: that of the last sync of the journal."""
    synced: list[bytes] = []
    sync = os.fsync

    def sync_and_look(descriptor: int) -> None:
        sync(descriptor)
        synced.append((tmp_path / JOURNAL_FILE).read_bytes() if (tmp_path / JOURNAL_FILE).exists() else b"")

    asked: list[tuple[Asked, Key]] = []

    def last_on_disk() -> Any:
        (tmp_path / "disk").mkdir(exist_ok=True)
        (tmp_path / "disk" / JOURNAL_FILE).write_bytes(synced[-1])
        return MasterJournal(tmp_path / "disk").records[-1]

    def watch(call: Any, what: Any) -> Any:
        def watched(*arguments: Any, **options: Any) -> Any:
            if (step := what(*arguments)) is not None:
                record = last_on_disk()
                assert (record.event, record.asked, record.key) == (Event.INTENT, *step)
                asked.append(step)
            return call(*arguments, **options)

        return watched

    monkeypatch.setattr(os, "fsync", sync_and_look)
    with bench() as nodes:
        rig, kept = NodeRig(nodes), MasterJournal(tmp_path)
        for node in Node:
            link: Any = rig.link(node)
            link.routine = watch(link.routine, journalled)
            link.download = watch(link.download, lambda layer, _: (Asked.PATTERN, Key(rig.job, layer)))
        printer, profiler = Printer(FOUR, rig, cure_ms=5, journal=kept), Profiler(FOUR, rig, journal=kept)
        zero: dict[str, Any] = {"layer_command": np.int32(0), "layers_printed": np.int32(0)}
        for device in (printer, profiler):
            device.initialize(0, zero)
        print_layer(printer, 1)
        profiler.do_step(0, 1, {"layers_printed": np.int32(1)})
    assert [step for step, _ in asked] == [Asked.PATTERN, *[Asked.PASS, Asked.CURE] * 4, Asked.SCAN]
    assert MasterJournal(tmp_path).records[-1].event is Event.DONE


def head(layer: int, *, job: int = JOB, crc: int = 0xABC2, flags: int = 0, **passes: int) -> NodeState:
    whole = {"state": State.SAFE, "layer": layer, "job": job, "passes": 4, "pattern_crc": crc, "flags": Flags(flags)}
    return node_state(**whole, **passes)


@pytest.mark.parametrize(
    ("mine", "theirs"),
    [
        (None, head(5, job=8, done=3)),  # nothing was asked for yet
        (LayerAsked(1), head(5, job=8, done=15)),  # the pattern never arrived
        (LayerAsked(2), head(1, done=15)),
        (LayerAsked(2), head(2)),
        (LayerAsked(2, 0b1, 0, 0xABC2), head(2)),  # the request never arrived
        (LayerAsked(2, 0b11, 0b01, 0xABC2), head(2, done=0b01)),
        (LayerAsked(2, 0b11, 0b01, 0xABC2), head(2, done=0b11)),  # the answer never arrived
        (LayerAsked(2, 0b11, 0b01, 0xABC2), head(2, done=0b01, unknown=0b10)),
        (
            LayerAsked(2, 0b11, 0b01, 0xABC2),
            head(2, flags=Flags.JOURNAL_UNREADABLE),
        ),  # refused before anything is asked
    ],
)
def test_head_may_know_more_or_less_where_an_answer_or_a_request_was_lost(mine: Any, theirs: NodeState) -> None:
    compare(mine, JOB, theirs)


@pytest.mark.parametrize(
    ("mine", "theirs", "word"),
    [
        (LayerAsked(2, 0b11, 0b11, 0xABC2), head(2, done=0b01), r"passes 1, 2 of layer 2 of job 7 done.*pass 1 done"),
        (LayerAsked(2, 0b01, 0b01, 0xABC2), head(2, done=0b11), "journals differ"),
        (
            LayerAsked(2, 0b01, 0b01, 0xABC2),
            head(2, done=0b01, unknown=0b10),
            r"pass 1 of layer 2 of job 7 done; the head's: layer 2 of job 7, pass 1 done, pass 2 unknown\)",
        ),
        (LayerAsked(2, 0b01, 0b01, 0xABC2), head(2, unknown=0b01), "no pass done, pass 1 unknown"),
        (LayerAsked(2, 0b01, 0b00, 0xABC2), head(2, unknown=0b01, crc=1), "begun with another pattern"),
        (LayerAsked(2, 0b01, 0b00, 0xABC2), head(1, done=15), "journals differ"),
        (LayerAsked(2, 0b01, 0b01, 0xABC2), head(2, job=8, done=0b01), "of job 8"),
        (LayerAsked(2), head(1, job=8, done=15), "of job 8"),
        (LayerAsked(2), head(0, job=0), "another head is mounted, its journal was erased"),
        (LayerAsked(1, 0b01, 0b00, 0xABC2), head(65535), "journals differ"),  # given up, as it could not be read
        (LayerAsked(2, 0b1111, 0b1111, 0xABC2), head(3), "something else was printed since"),
        (
            LayerAsked(2, 0b01, 0b01, 0xABC2),
            head(2, done=0b01, crc=1),
            r"another pattern .*00000001.*0000abc2",
        ),
    ],
)
def test_contradictory_journals_stop_the_run_with_a_message(mine: Any, theirs: NodeState, word: str) -> None:
    with pytest.raises(JournalsDiffer, match=word) as caught:
        compare(mine, JOB, theirs)
    assert "inkloop run" in str(caught.value)


def printer_of(folder: Path, rig: NodeRig) -> Printer:
    printer = Printer(FOUR, rig, cure_ms=5, journal=MasterJournal(folder))
    printer.initialize(0, {"layer_command": np.int32(0)})
    return printer


@pytest.mark.compiled
def test_run_keeps_its_job_even_without_a_checkpoint(tmp_path: Path) -> None:
    """It was stopped in layer 1: what the head has done of it is continued, not printed again on top."""
    with bench() as nodes:
        print_layer(printer_of(tmp_path, NodeRig(nodes, job=7)), 1)
        surface = nodes.surface.copy()
        again = NodeRig(nodes, job=8)
        assert print_layer(printer_of(tmp_path, again), 1)["layers_printed"] == 1
        assert again.job == 7
        np.testing.assert_array_equal(nodes.surface, surface)


@pytest.mark.compiled
def test_devices_of_one_rig_open_the_journal_once_and_each_record_has_the_session(tmp_path: Path) -> None:
    with bench() as nodes:
        rig, kept = NodeRig(nodes), MasterJournal(tmp_path)
        profiler = Profiler(FOUR, rig, journal=kept)
        for device in (Printer(FOUR, rig, journal=kept), profiler):
            device.initialize(0, {"layer_command": np.int32(0), "layers_printed": np.int32(0)})
        profiler.do_step(0, 1, {"layers_printed": np.int32(0)})
    found = MasterJournal(tmp_path).records
    assert [record.event for record in found] == [Event.OPENED, Event.INTENT, Event.DONE]
    assert {record.session for record in found} == {rig.session}


@pytest.mark.compiled
def test_checkpoint_that_is_older_than_the_journal_is_refused_with_a_message(tmp_path: Path) -> None:
    with bench() as nodes:
        first = printer_of(tmp_path, NodeRig(nodes))
        for layer in (1, 2):
            print_layer(first, layer)
        surface = nodes.surface.copy()
        with pytest.raises(JournalsDiffer, match=r"has begun layer 2 already.*restored from a copy"):
            print_layer(printer_of(tmp_path, NodeRig(nodes)), 1)
        np.testing.assert_array_equal(nodes.surface, surface)


@pytest.mark.compiled
def test_run_without_its_checkpoints_is_advised_to_begin_a_new_part(tmp_path: Path) -> None:
    """Its first request would be the scan of layer 0, which the profiler only refuses as out of sequence."""
    with bench() as nodes:
        print_layer(printer_of(tmp_path, NodeRig(nodes)), 1)
        profiler = Profiler(FOUR, NodeRig(nodes), journal=MasterJournal(tmp_path))
        profiler.initialize(0, {"layers_printed": np.int32(0)})
        with pytest.raises(JournalsDiffer, match=r"layer 0 is due.*begun layer 1.*folder layers removed.*take it off"):
            profiler.do_step(0, 1, {"layers_printed": np.int32(0)})


@pytest.mark.compiled
def test_checkpoint_of_another_job_is_refused_with_a_message(tmp_path: Path) -> None:
    with bench() as nodes:
        saved = printer_of(tmp_path / "one", NodeRig(nodes, job=7)).save()
        other = printer_of(tmp_path / "other", NodeRig(nodes, job=8))
        with pytest.raises(JournalError, match=r"journal of job 8, expected job 7 of the run"):
            other.restore(saved)


@pytest.mark.compiled
def test_head_that_has_forgotten_the_job_is_not_printed_with(tmp_path: Path) -> None:
    with bench() as nodes:
        print_layer(printer_of(tmp_path, NodeRig(nodes)), 1)
    with bench() as new:
        rig = NodeRig(new)
        with pytest.raises(JournalsDiffer, match="its journal was erased"):
            printer_of(tmp_path, rig)
        assert not [asked for node in Node for asked in rig.link(node).asked], "nothing was asked of the nodes"


@pytest.mark.compiled
@pytest.mark.parametrize("lost", [2, 5, 9])
def test_head_that_cannot_read_its_journal_jets_nothing_twice(tmp_path: Path, lost: int) -> None:
    """Read again, the print goes on; given up, a new part is begun."""
    with bench() as nodes:
        print_layer(printer_of(tmp_path, NodeRig(nodes)), 1)
        surface = nodes.surface.copy()
        nodes.decay(lost)
        nodes.power_up()
        with pytest.raises(NotReady, match="head: its journal could not be read at power-up"):
            printer_of(tmp_path, NodeRig(nodes))
        nodes.restore()
        nodes.power_up()
        assert print_layer(printer_of(tmp_path, NodeRig(nodes)), 1)["layers_printed"] == 1
        nodes.decay(lost)
        nodes.power_up()
        assert "head: cleared, its open layer is given up" in list(clear_all(NodeRig(nodes), give_up=True))
        with pytest.raises(JournalsDiffer, match="inkloop run"):
            printer_of(tmp_path, NodeRig(nodes))
        np.testing.assert_array_equal(nodes.surface, surface)
