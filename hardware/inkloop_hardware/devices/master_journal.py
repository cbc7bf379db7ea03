"""Journal of the master: an append-only file in the run folder, a line per record.

An INTENT is on the disk (fsync) before a device is asked for a step, a DONE after the device has confirmed it. So an
INTENT without DONE is a step that may have happened. The journal of a node decides whether it has; a mapped rig has
none, so that a person looks and says what became of the layer. Each line is a JSON object and its CRC-32; a last line
that is incomplete or damaged precedes its request, so it is cut off.
"""

from __future__ import annotations

import json
import os
import zlib
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from inkloop.files import open_own, reason_of, sync_folder
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.services import Key

JOURNAL_FILE = "master.journal"


class JournalError(HardwareError):
    """The journal of a run cannot be read or written, or belongs to another job."""

    has_own_remedy = True


class Event(StrEnum):
    """Event of a record."""

    OPENED = "opened"
    """a master with a new session number began or resumed the job"""
    INTENT = "intent"
    DONE = "done"
    PRINTED = "printed"
    BLANK = "blank"
    UNKNOWN = "unknown"
    """the last three: a person has looked at a layer of a mapped rig that was begun and not finished"""


class Asked(StrEnum):
    """Request that a record is about."""

    NOTHING = "nothing"
    PATTERN = "pattern"
    PASS = "pass"
    CURE = "cure"
    SCAN = "scan"
    STEP = "step"
    """a step of the mapping that acts; its number, from 1, is the pass of the key"""
    LAYER = "layer"
    """all steps of the mapping"""


@dataclass(frozen=True)
class MasterRecord:
    """One line. number: counts up from 1; pattern_crc: CRC-32 of the layer's pattern as transferred, 0 without one."""

    number: int
    event: Event
    asked: Asked
    key: Key
    pattern_crc: int
    session: int

    def line(self) -> bytes:
        """The line of the file; its time is for people."""
        content = {"number": self.number, "event": self.event, "asked": self.asked, **vars(self.key)}
        content |= {"pattern_crc": f"{self.pattern_crc:08x}", "session": self.session}
        content |= {"time": datetime.now(UTC).isoformat(timespec="milliseconds")}
        text = json.dumps(content).encode()
        return b"%s %08x\n" % (text, zlib.crc32(text))

    @classmethod
    def of(cls, line: bytes) -> MasterRecord | None:
        """From a line without its line end; None for one that is incomplete or altered."""
        text, _, crc = line.rpartition(b" ")
        try:
            if int(crc, 16) != zlib.crc32(text):
                return None
            found = json.loads(text)
            key = Key(*(int(found[name]) for name in ("job", "layer", "pass_", "attempt")))
            event, asked = Event(found["event"]), Asked(found["asked"])
            return cls(int(found["number"]), event, asked, key, int(found["pattern_crc"], 16), int(found["session"]))
        except (ValueError, KeyError, TypeError):
            return None


@dataclass(frozen=True)
class LayerAsked:
    """The newest layer that a head was asked for. asked, done: a bit per pass; pattern_crc: of its last transfer."""

    layer: int
    asked: int = 0
    done: int = 0
    pattern_crc: int = 0


class MasterJournal:
    """The journal of a run folder; without a folder it is kept in memory only, for loops that are not resumed.

    Nothing is read or written before the first call. Every call raises JournalError: a file that cannot be read or
    written, or that was altered in the middle.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = None if folder is None else folder / JOURNAL_FILE
        self._records: list[MasterRecord] | None = None

    @property
    def records(self) -> tuple[MasterRecord, ...]:
        """All of them, oldest first."""
        return tuple(self._known())

    @property
    def job(self) -> int | None:
        """The job of the run, None for a new one."""
        records = self._known()
        return records[-1].key.job if records else None

    @property
    def session(self) -> int | None:
        """Session number of the last master, None for the first."""
        records = self._known()
        return records[-1].session if records else None

    @property
    def layer(self) -> LayerAsked | None:
        """The newest layer that a head was asked for in this job; None before the first."""
        found: LayerAsked | None = None
        for record in self._known():
            if record.asked not in (Asked.PATTERN, Asked.PASS) or record.key.job != self.job:
                continue
            if found is None or record.key.layer != found.layer:
                found = LayerAsked(record.key.layer)
            bit = (record.asked is Asked.PASS) << record.key.pass_
            done = bit if record.event is Event.DONE else 0
            found = LayerAsked(found.layer, found.asked | bit, found.done | done, record.pattern_crc)
        return found

    def begin(self, rig: Rig) -> None:
        """Give a closed rig the job of this run and record its session; does nothing for an open one."""
        if rig.is_open:
            return
        if self.job is not None:
            rig.job = self.job
        self._append(Event.OPENED, Asked.NOTHING, Key(rig.job, 0), 0, rig.session)

    def resume(self, rig: Rig, job: int) -> None:
        """Give the rig the job of a saved state. JournalError if the run folder's journal is of another one."""
        if self._path is not None and job != self.job:
            raise JournalError(
                f"{self._path}: is the journal of job {self.job}, expected job {job} of the run: was it removed or "
                "replaced? Restore it and continue with `inkloop resume`, or begin a new part with `inkloop run`"
            )
        rig.job = job

    def intend(self, asked: Asked, key: Key, pattern_crc: int = 0) -> None:
        """Record a step before its request: on the disk when this returns."""
        self._append(Event.INTENT, asked, key, pattern_crc)

    def done(self, asked: Asked, key: Key, pattern_crc: int = 0) -> None:
        """Record that the node has confirmed the step: on the disk when this returns."""
        self._append(Event.DONE, asked, key, pattern_crc)

    def settle(self, seen: Event, key: Key, pattern_crc: int) -> None:
        """Record what a person has seen of an open layer: PRINTED, BLANK or UNKNOWN."""
        self._append(seen, Asked.LAYER, key, pattern_crc)

    def _append(self, event: Event, asked: Asked, key: Key, crc: int, session: int | None = None) -> None:
        records = self._known()
        record = MasterRecord(len(records) + 1, event, asked, key, crc, session or self.session or 0)
        if self._path is not None:
            self._write(self._path, record.line())
        records.append(record)

    def _write(self, path: Path, line: bytes) -> None:
        """Append and sync; the part of a line that did not fit is removed again."""
        try:
            is_new = not path.exists()
            path.parent.mkdir(parents=True, exist_ok=True)
            with open_own(path, "ab", buffering=0) as file:
                before = file.tell()
                try:
                    if file.write(line) != len(line):
                        raise OSError("no room for a whole line")
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(before)
                    raise
            if is_new:
                sync_folder(path.parent)
        except OSError as error:
            raise JournalError(
                f"{path}: cannot be written: {reason_of(error)}; its step was not requested; make room, "
                "then continue with `inkloop resume`"
            ) from error

    def _known(self) -> list[MasterRecord]:
        if self._records is None:
            self._records = [] if self._path is None else _read(self._path)
        return self._records


def _read(path: Path) -> list[MasterRecord]:
    """The records of a file; an incomplete last line is cut off."""
    try:
        content = b""
        with suppress(FileNotFoundError), open_own(path, "rb") as file:
            content = file.read()
        lines = content.split(b"\n")
        found = [MasterRecord.of(line) for line in lines[:-1]]
        torn = lines[-1]
        if found and found[-1] is None:
            found.pop()
            torn = lines[-2] + b"\n" + torn
        records = [record for record in found if record is not None]
        if [record.number for record in records] != list(range(1, len(found) + 1)):
            raise JournalError(
                f"{path}: was altered, or its disk is damaged: its lines do not count from 1 to {len(found)}, each "
                "with its checksum; only the journal of the head still holds what was printed: begin a new part "
                "with `inkloop run`"
            )
        if torn:
            with open_own(path, "r+b") as file:
                file.truncate(path.stat().st_size - len(torn))
                os.fsync(file.fileno())
    except OSError as error:
        raise JournalError(
            f"{path}: cannot be read: {reason_of(error)}; let this user read it, then continue with `inkloop resume`"
        ) from error
    return records
