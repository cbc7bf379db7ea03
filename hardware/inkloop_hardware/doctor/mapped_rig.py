"""Frames that a mapping waits for, heard on a bus to which nothing is sent."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor.adapter_check import configured
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.doctor.listening import LISTEN_S, LISTEN_SILENCES, Heard, judge_bus, listen
from inkloop_hardware.doctor.status import check_second_reader
from inkloop_hardware.mapped.mapping_file import RigMapping
from inkloop_hardware.mapped.readings import Readings
from inkloop_hardware.protocol.codec import id_of, id_text

CYCLES = 3.0
"""Cycles of a frame in which it must come (assumed)."""


def bus_of(settings: BusSettings, mapping: RigMapping) -> BusSettings:
    """The settings of a bus for the frames of a mapping."""
    return replace(settings, fd=settings.fd or mapping.needs_fd)


def judge_rig(
    adapter: Adapter, mapping: RigMapping, monotonic: Callable[[], float] = time.monotonic
) -> Iterator[Finding]:
    """Bus, and every frame that the mapping waits for: an error for one that does not come or cannot be read."""
    readings = Readings(mapping.codec)
    heard = listen(adapter, mapping.codec, _seconds(adapter.settings, mapping), monotonic, readings.take)
    yield from judge_bus(heard, foreign=True)
    for message, signals in mapping.tables.awaited.items():
        yield _judged(message, signals, readings, mapping, heard)


def status(settings: BusSettings, mapping: RigMapping) -> Iterator[str]:
    """A line for each frame that the mapping waits for, beside a print or without one. AnotherMaster, BusError."""
    check_second_reader(settings)
    with closing(Adapter(bus_of(configured(settings), mapping))) as adapter:
        for finding in judge_rig(adapter, mapping):
            yield finding.found if finding.grade is Grade.OK else f"{finding.found}; {finding.advice}"


def _seconds(settings: BusSettings, mapping: RigMapping) -> float:
    cycles = [mapping.codec.cycle_time(message) or 0.0 for message in mapping.tables.awaited]
    return max(LISTEN_S, LISTEN_SILENCES * settings.silence_s, CYCLES * max(cycles, default=0.0))


def _judged(message: str, signals: dict[str, str], readings: Readings, mapping: RigMapping, heard: Heard) -> Finding:
    name = f"{message} ({id_text(id_of(mapping.codec.message(message)))})"
    waiting = " and ".join(dict.fromkeys(signals.values()))
    if not readings.counts[message]:
        advice = f"{waiting} waits for it: is the rig powered, on this bus, at this bit rate, and is this its id?"
        return Finding.error("frames", f"{name}: none came in {heard.lasted:.1f} s", advice)
    count = f"{readings.counts[message]} in {heard.lasted:.1f} s"
    if message not in readings.newest:
        advice = f"{waiting} waits for it: compare the DBC with the rig"
        return Finding.error("frames", f"{name}: {count}, but {readings.found(message, '')}", advice)
    values = ", ".join(f"{signal}: {readings.found(message, signal)}" for signal in signals)
    if any(signal in readings.newest[message].dropped for signal in signals):
        return Finding.warning("frames", f"{name}: {count}; {values}", "compare limits and value tables with the rig")
    return Finding.ok("frames", f"{name}: {count}; {values}")
