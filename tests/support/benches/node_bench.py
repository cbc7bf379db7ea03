"""The firmware's nodes on the emulated world, compiled once and driven by bytes and an injected clock."""

from __future__ import annotations

import ctypes
import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag, auto
from functools import cache
from pathlib import Path
from struct import pack, unpack, unpack_from
from typing import Any, Self

import numpy as np

from inkloop.fmu_writer import archive
from inkloop_hardware.protocol.c_codec import write_codec
from inkloop_hardware.protocol.codec import BENCH_DBC, Frame
from inkloop_hardware.protocol.services import Routine
from support import compiled
from support.places import C_SOURCES, ROOT

FIRMWARE = ROOT / "hardware" / "firmware"
CORE = sorted((FIRMWARE / "node").glob("*.c"))
WIRE = sorted((FIRMWARE / "can").glob("*.c"))
FAULTS = sorted((FIRMWARE / "host" / "faults").glob("*.c"))
HOST = [FIRMWARE / "host" / f"{name}.c" for name in ("bench", "board", "measurements", "surface_file", "world")]
FMUS = ROOT / "fmus"
KERNELS = [
    FMUS / "layer_deposition" / "layer_map.c",
    FMUS / "deposition" / "droplet_volume.c",
    *(FMUS / "profile_sensor" / f"{name}.c" for name in ("scan", "reading")),
    FMUS / "common" / "random.c",
]
EMULATED = [FMUS / name / "variables.toml" for name in ("layer_deposition", "profile_sensor")]
SANITIZERS = os.environ.get("INKLOOP_SANITIZERS", "").split()
"""More flags for everything that is compiled here; test_firmware_sanitized.py sets them."""
STRICT = ("-std=c11", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror", *SANITIZERS)
PLACES = (
    *(f"-I{FIRMWARE / name}" for name in ("node", "can", "host", "host/faults")),
    *(f"-isystem{FMUS / name}" for name in ("deposition", "layer_deposition", "profile_sensor", "common")),
)

HEAD, STAGE, CURE, PROFILER = range(4)
STATES = (
    *("SAFE", "IDLE", "RECEIVING", "VERIFIED", "PRINTING", "PRINTED"),
    *("CURING", "CURED", "SCANNING", "MAP_READY", "FAULT"),
)
LAMP, GATE, MOTION = 1, 2, 4
HEAD_ROLE, STAGE_ROLE, CURE_ROLE, PROFILER_ROLE = 1, 2, 4, 8
DONE, DONE_BEFORE, UNDER_WAY, UNKNOWN, NEVER = range(5)
RASTER = (0, 1, 2, 3)


class Nrc(IntEnum):
    """Codes that refuse a request."""

    BUSY = 0x21
    CONDITIONS = 0x22
    SEQUENCE = 0x24
    FAILED = 0x26
    RANGE = 0x31
    PENDING = 0x78


class Broken(IntFlag):
    """Defects of the printer: BROKEN_... of world.h."""

    GATE_STAYS_OPEN = auto()
    GATE_STAYS_CLOSED = auto()
    LAMP_STAYS_ON = auto()
    NOT_READY = auto()
    WORK_FAILS = auto()
    WORK_HANGS = auto()
    STORAGE_FULL = auto()
    LAMP_STAYS_OFF = auto()


class MasterAlive(ctypes.Structure):
    _fields_ = (("enables", ctypes.c_uint8), ("session", ctypes.c_uint16), ("job", ctypes.c_uint32))


def codec() -> Path:
    """The folder of the C codec that is generated from the DBC."""
    return compiled.once(_write_codec, BENCH_DBC)


def _write_codec(folder: Path, dbc: Path) -> None:
    write_codec(dbc, folder)


def _write_parameters(folder: Path, *definitions: Path) -> None:
    """emulated_parameters.h, which the emulator includes."""
    texts = map(str, definitions)
    assert archive.main(["emulated", "--definition", *texts, "--out", str(folder / "emulated_parameters.h")]) == 0


def firmware_objects(sources: Sequence[Path]) -> list[Path]:
    """Object files; the firmware itself with every conversion written out."""
    parameters = compiled.once(_write_parameters, *EMULATED)
    flags = (*STRICT, "-fPIC", *PLACES, f"-I{codec()}", f"-I{parameters}")
    return [
        compiled.object_of(source, (*flags, "-Wconversion") if source.is_relative_to(FIRMWARE) else flags)
        for source in sources
    ]


def firmware_library(name: str, sources: Sequence[Path]) -> ctypes.CDLL:
    """A shared library of these sources, loaded."""
    return ctypes.CDLL(str(compiled.linked(name, firmware_objects(sources), (*SANITIZERS, "-shared"))))


@cache
def library() -> ctypes.CDLL:
    """Core, host HAL, kernels and probes."""
    probe = C_SOURCES / "bench_probe.c"
    wire = (*WIRE, codec() / "inkloop.c")
    loaded = firmware_library("node_bench.so", (*CORE, *HOST, *KERNELS, *wire, probe))
    for name in ("bench_create", "probe_node", "probe_options", "probe_surface", "probe_storage"):
        getattr(loaded, name).restype = ctypes.c_void_p
    for name in ("node_request", "node_take_answer"):
        getattr(loaded, name).restype = ctypes.c_size_t
    loaded.probe_count.restype = ctypes.c_uint32
    loaded.bench_set.restype = ctypes.c_bool
    loaded.bench_set.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double)
    return loaded


@dataclass(frozen=True)
class State:
    """The answer to identifier 0100."""

    state: str
    cause: int
    needs_operator: bool
    stopped: bool
    pattern_loaded: bool
    job: int
    layer: int
    passes: int
    done: int
    unknown: int
    cured: int
    step: int
    boots: int
    session: int
    pattern_crc: int
    gate_pulses: int
    by_watchdog: bool
    journal_unread: bool


@dataclass(frozen=True)
class Times:
    """The answer to identifier 0101 [ms of the node's clock]."""

    now: int
    master_alive: int
    off: int
    lamp_on: int
    lamp_off: int
    gate_opened: int
    gate_closed: int


def _count(which: int) -> property:
    return property(lambda bench: int(bench.c.probe_count(bench.bench, which)))


class NodeBench:
    """Four nodes, or one with all roles; a master that lives as long as `master` is set."""

    def __init__(self, *, clock: int = 1000, folder: Path | None = None, **options: float) -> None:
        self.c = library()
        options = {"nx": 9, "ny": 8, **options}
        chosen = self.c.probe_options()
        for name, value in options.items():
            assert self.c.bench_set(chosen, name.encode(), float(value)), name
        why = ctypes.create_string_buffer(200)
        place = str(folder).encode() if folder else None
        self.bench = ctypes.c_void_p(self.c.bench_create(ctypes.c_void_p(chosen), place, why, ctypes.c_size_t(200)))
        if not self.bench:
            raise ValueError(why.value.decode())
        self.shape = (int(options["nx"]), int(options["ny"]))
        self.count = 1 if options.get("one_node") else 4
        self.clock = clock
        self.master: MasterAlive | None = MasterAlive(LAMP | GATE | MOTION, 1, 7)
        self.last_alive = clock - 1000
        for node in range(self.count):
            self.power_up(node)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.c.bench_delete(self.bench)

    def power_up(self, node: int = HEAD) -> None:
        self.c.bench_power_up(self.bench, node, ctypes.c_uint32(self.clock))

    def node(self, node: int) -> ctypes.c_void_p:
        return ctypes.c_void_p(self.c.probe_node(self.bench, node))

    def tick(self, milliseconds: int = 5, step: int = 5) -> None:
        """Lets time pass; the master sends MasterAlive every 100 ms."""
        for _ in range(0, milliseconds, step):
            self.clock += step
            if self.master and self.clock - self.last_alive >= 100:
                self.send_keep_alive()
            self.c.probe_tick(self.bench, ctypes.c_uint32(self.clock))

    def send_keep_alive(self, master: MasterAlive | None = None) -> None:
        alive = master or self.master
        for node in range(self.count):
            self.c.node_master_alive(self.node(node), ctypes.c_uint32(self.clock), ctypes.byref(alive))  # type: ignore[arg-type]
        self.last_alive = self.clock

    def roles(self, roles: int) -> None:
        """Other roles for the first node, until its next power-up."""
        self.c.probe_roles(self.bench, HEAD, roles)

    def join(self) -> None:
        """Put every node on a bus."""
        for node in range(self.count):
            self.c.probe_join(self.bench, node)

    def give(self, frame: Frame) -> None:
        """A frame of the bus, which every node receives."""
        data, now = frame.data, ctypes.c_uint32(self.clock)
        for node in range(self.count):
            self.c.probe_frame(node, ctypes.c_uint32(frame.arbitration_id), data, len(data), now)

    def sent(self, node: int = HEAD) -> Frame | None:
        """The next frame of a node on the bus."""
        number, data = ctypes.c_uint32(), ctypes.create_string_buffer(8)
        length = self.c.probe_next(node, ctypes.c_uint32(self.clock), ctypes.byref(number), data)
        return Frame(number.value, data.raw[:length]) if length else None

    def measured(self, node: int, memory: Any, now: int) -> Frame | None:
        """The measurement that an emulated node sends now; memory: of when it last did."""
        number, data = ctypes.c_uint32(), ctypes.create_string_buffer(8)
        length = self.c.probe_measurement(self.bench, memory, node, ctypes.c_uint32(now), ctypes.byref(number), data)
        return Frame(number.value, data.raw[:length]) if length else None

    def stop(self, active: bool) -> None:
        for node in range(self.count):
            self.c.node_stop_request(self.node(node), ctypes.c_uint32(self.clock), ctypes.c_bool(active))

    def raw(self, request: bytes, node: int = HEAD, room: int = 4095) -> bytes:
        """The answer that comes at once."""
        answer = ctypes.create_string_buffer(room)
        length = self.c.node_request(
            self.node(node),
            ctypes.c_uint32(self.clock),
            request,
            ctypes.c_size_t(len(request)),
            answer,
            ctypes.c_size_t(room),
        )
        return answer.raw[:length]

    def late(self, node: int = HEAD) -> bytes:
        """An answer that has become ready."""
        answer = ctypes.create_string_buffer(64)
        length = self.c.node_take_answer(self.node(node), answer, ctypes.c_size_t(64))
        return answer.raw[:length]

    def ask(self, request: bytes, node: int = HEAD) -> bytes:
        """The final answer; time passes while the node is busy."""
        answer = self.raw(request, node)
        for _ in range(8000):
            if answer[:1] != b"\x7f" or answer[2] != Nrc.PENDING:
                return answer
            self.tick()
            answer = self.late(node) or answer
        raise AssertionError("the node stays busy")

    def routine(
        self,
        routine: int,
        layer: int = 0,
        which: int = 0,
        attempt: int = 1,
        option: bytes = b"",
        *,
        job: int = 7,
        kind: int = 1,
    ) -> bytes:
        return pack(">BBHIHBB", 0x31, kind, routine, job, layer, which, attempt) + option

    def run(self, routine: int, node: int = HEAD, **key: Any) -> int:
        """Outcome of a routine, or minus the code that refuses it."""
        answer = self.ask(self.routine(routine, **key), node)
        return -answer[2] if answer[0] == 0x7F else answer[4]

    def clear(self, node: int = HEAD, option: int = 0) -> int:
        return self.run(Routine.CLEAR, node, option=bytes([option]))

    def state(self, node: int = HEAD) -> State:
        found = self.raw(b"\x22\x01\x00", node)[3:]
        state, cause, _roles, flags, job, layer, *counts = unpack(">4BIH6BHHIII", found)
        passes, done, unknown, cured, _book, step, boots, session, crc, _now, pulses = counts
        needs_operator, stopped, loaded = (bool(flags & bit) for bit in (1, 2, 4))
        first = (STATES[state], cause, needs_operator, stopped, loaded, job, layer)
        return State(
            *first, passes, done, unknown, cured, step, boots, session, crc, pulses, bool(flags & 64), bool(flags & 128)
        )

    def state_and_cause(self, node: int = HEAD) -> tuple[str, int]:
        found = self.state(node)
        return found.state, found.cause

    def times(self, node: int = HEAD) -> Times:
        return Times(*unpack(">7I", self.raw(b"\x22\x01\x01", node)[3:]))

    def journal(self, node: int = HEAD) -> list[tuple[int, ...]]:
        """(kind, step, pass) of the records, oldest first."""
        records = self.raw(b"\x22\x01\x10", node)[3:]
        return [tuple(records[at + 4 : at + 7]) for at in range(0, len(records), 40)][::-1]

    def download(self, blob: bytes, layer: int, *, coded: int = 0, block: int = 4093, crc: int | None = None) -> int:
        """0, or minus the code that refuses the pattern."""
        steps = [pack(">BBBII", 0x34, coded, 0x44, layer, len(blob))]
        steps += [
            bytes([0x36, (1 + number) % 256]) + blob[at : at + block]
            for number, at in enumerate(range(0, len(blob), block))
        ]
        steps.append(pack(">BI", 0x37, zlib.crc32(blob) if crc is None else crc))
        for step in steps:
            answer = self.raw(step)
            if answer[0] == 0x7F:
                return -answer[2]
        return 0

    def upload(self, layer: int, node: int = PROFILER, block: int = 4095) -> bytes:
        """The bytes of the height map; the checksum is checked."""
        size, *shape = unpack(">IHH", self.raw(b"\x22\x01\x03", node)[3:])
        assert tuple(shape) == self.shape
        assert self.raw(pack(">BBBII", 0x35, 0, 0x44, layer, size), node)[0] == 0x75
        found, number = b"", 0
        while len(found) < size:
            number += 1
            found += self.raw(bytes([0x36, number % 256]), node, block)[2:]
        assert unpack_from(">I", self.raw(b"\x37", node), 1)[0] == zlib.crc32(found)
        return found

    def ready(self) -> Self:
        """All nodes cleared, the stage homed."""
        self.tick(100)
        for node in range(self.count):
            assert self.clear(node) == DONE
        assert self.run(Routine.HOME, STAGE if self.count == 4 else HEAD) == DONE
        return self

    def print_layer(self, pattern: Any, layer: int, order: tuple[int, ...] = RASTER) -> None:
        """Download and passes, each with its cure."""
        assert self.download(pattern_blob(pattern, passes=len(order)), layer) == 0
        for number, colour in enumerate(order):
            assert self.jet(layer, number, colour) == DONE
            assert self.cure(layer, number) == DONE

    def jet(self, layer: int, which: int = 0, colour: int | None = None) -> int:
        """A pass; its colour is its number, unless given."""
        return self.run(Routine.PASS, layer=layer, which=which, option=bytes([which if colour is None else colour]))

    def cure(self, layer: int, which: int = 0, attempt: int = 1, milliseconds: int = 20) -> int:
        node = CURE if self.count == 4 else HEAD
        return self.run(Routine.CURE, node, layer=layer, which=which, attempt=attempt, option=pack(">H", milliseconds))

    def scan(self, layer: int, attempt: int = 1) -> int:
        return self.run(Routine.SCAN, PROFILER if self.count == 4 else HEAD, layer=layer, attempt=attempt)

    @property
    def surface(self) -> Any:
        """The surface as it is [m]; a view that can be set."""
        pointer = ctypes.cast(self.c.probe_surface(self.bench), ctypes.POINTER(ctypes.c_double))
        return np.ctypeslib.as_array(pointer, self.shape)

    def storage(self, node: int = HEAD) -> Any:
        pointer = ctypes.cast(self.c.probe_storage(self.bench, node), ctypes.POINTER(ctypes.c_uint8))
        return np.ctypeslib.as_array(pointer, (4 * 4096,))

    def broken(self, what: int) -> None:
        self.c.probe_break(self.bench, ctypes.c_uint32(what))

    def tear(self, written: int, node: int = HEAD) -> None:
        """The next record is torn after so many bytes."""
        self.c.probe_tear(self.bench, node, ctypes.c_int32(written))

    def wear(self, node: int = HEAD) -> None:
        """From now on the flash does not hold what is written to it, and does not say so."""
        self.c.probe_wear(self.bench, node)

    def refuse_slots(self, first: int, end: int, node: int = HEAD) -> None:
        """From now on these slots of the journal refuse to be written, whatever they read."""
        offsets = (ctypes.c_uint32(slot // 102 * 4096 + slot % 102 * 40) for slot in (first, end))
        self.c.probe_refuse_slots(self.bench, node, *offsets)

    def decay(self, records: int, node: int = HEAD) -> None:
        """The newest records of a node cannot be read any more."""
        self.c.bench_decay(self.bench, node, ctypes.c_uint32(records))

    def decay_slots(self, slots: Sequence[int], node: int = HEAD) -> None:
        """The same for slots of its journal."""
        for slot in slots:
            self.c.probe_decay(self.bench, node, ctypes.c_uint32(slot // 102 * 4096 + slot % 102 * 40))

    def restore(self, node: int = HEAD) -> None:
        """The storage of a node is as good as new; it holds what it held."""
        self.c.probe_restore(self.bench, node)

    def memory(self, sectors: int, sector_bytes: int, write_unit: int, node: int = HEAD) -> None:
        """The storage of a node from its next power-up on."""
        self.c.probe_memory(self.bench, node, *map(ctypes.c_uint32, (sectors, sector_bytes, write_unit)))

    def erase_slowly(self, milliseconds: int, node: int = HEAD) -> None:
        """From now on an erasure takes so long, by the clock of the world."""
        self.c.probe_erase_slowly(self.bench, node, ctypes.c_uint32(milliseconds))

    def refuse_work(self, node: int = HEAD) -> None:
        """From now on the devices of a node cannot begin anything."""
        self.c.probe_refuse_work(self.bench, node)

    def work(self, node: int = HEAD) -> tuple[int, ...]:
        """Last work given to its devices: kind, whether dry, colour, station, layer."""
        found = (ctypes.c_uint32 * 5)()
        self.c.probe_work(self.bench, node, found)
        return tuple(found)

    def light_while_recording(self, node: int = HEAD) -> None:
        """From now on the lamp comes on by itself while a node writes a record, and stays on."""
        self.c.probe_light_while_recording(self.bench, node)

    gate_openings, lamp_pulses, lamp_with_gate, world_clock = map(_count, range(4))
    """Counts of the world; ticks with the lamp on and the gate not closed; its clock [ms]."""


def pattern_blob(pattern: Any, *, passes: int = 4, bits: int = 2) -> bytes:
    """A pattern as it crosses the bus."""
    cells = np.asarray(pattern, np.uint8)
    planes = (cells.ravel()[:, None] >> np.arange(bits)[::-1]) & 1
    head = pack(">BBHHBB", 1, bits, *cells.shape, passes, 0)
    return head + np.packbits(planes.ravel().astype(np.bool_)).tobytes()


def run_length(blob: bytes) -> bytes:
    """The same with its cells run-length coded, runs of three or more as runs."""
    coded, cells, at = bytearray(blob[:8]), blob[8:], 0
    literal = bytearray()

    def flush() -> None:
        for first in range(0, len(literal), 128):
            part = literal[first : first + 128]
            coded.extend(bytes([len(part) - 1]) + part)
        literal.clear()

    while at < len(cells):
        run = 1
        while run < 129 and at + run < len(cells) and cells[at + run] == cells[at]:
            run += 1
        if run >= 3:
            flush()
            coded.extend((run + 126, cells[at]))
        else:
            literal.extend(cells[at : at + run])
        at += run
    flush()
    return bytes(coded)


def heights(blob: bytes, resolution: float) -> tuple[Any, Any]:
    """Readings [m] (0 where not valid) and valid cells of an uploaded map."""
    version, _zero, nx, ny, _nanometres, datum = unpack_from(">BBHHHi", blob)
    assert version == 1
    cells = nx * ny
    steps = np.frombuffer(blob, ">i2", cells, 12).astype(np.int64) + datum
    valid = np.unpackbits(np.frombuffer(blob, np.uint8, offset=12 + 2 * cells), count=cells).astype(np.bool_)
    return np.where(valid, steps * resolution, 0.0).reshape(nx, ny), valid.reshape(nx, ny)


def process() -> Path:
    """The emulator as a program, with the codec generated from the DBC."""
    main = (FIRMWARE / "host" / f"{name}.c" for name in ("emulation", "hub", "main"))
    sources = (*CORE, *WIRE, *HOST, *FAULTS, *main, *KERNELS, codec() / "inkloop.c")
    return compiled.linked("bench_nodes", firmware_objects(sources), SANITIZERS)
