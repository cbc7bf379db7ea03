"""Tables of a mapping file, which binds the layer contract to a rig with its own frames and services."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from inkloop.units import SUFFIXES

Identifier = Annotated[int, Field(ge=0, le=0xFFFF)]
Bytes = Annotated[int, Field(ge=1, le=8)]
Limit = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Value = int | Finite | str
"""A number, a name of the signal's value table, or a template of a number such as "{layer}"."""

CELLS = {"int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
METRES = {name: SUFFIXES["m"][name.replace("µ", "u")] for name in ("nm", "um", "µm", "mm", "m")}

SECONDS = SUFFIXES["s"]


class Table(BaseModel):
    """Base of all tables: other keys than the declared ones are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Peer(Table):
    """`[peers.NAME]`: a device that answers services over ISO-TP, normal addressing; ids beyond 0x7FF have 29 bits."""

    request: int | str = Field(description="id of requests to it, or the name of that message in the DBC")
    answer: int | str = Field(description="id of its answers, or the name of that message in the DBC")
    answer_s: Limit = Field(default=1.0, description="seconds for it to begin an answer")
    fd: bool = Field(default=False, description="requests go in CAN FD frames of up to 64 bytes")


class PatternTable(Table):
    """`[pattern]`: a pattern as bytes: header, then the cells."""

    header: str = Field(default="", description="hexadecimal template before the cells")
    bits: Literal[1, 2, 4, 8] = Field(default=1, description="of a cell: 0 none, 1 material A, 2 material B")
    bit_order: Literal["msb", "lsb"] = Field(default="msb", description="which bit of a byte is the first cell")
    fastest: Literal["x", "y"] = Field(default="y", description="axis along which neighbouring cells follow")
    whole_lines: bool = Field(default=False, description="each line of cells begins with a new byte")


class MapTable(Table):
    """`[map]`: a height map as bytes: header, a number for each cell, then optionally a bit for each valid cell."""

    header: str = Field(default="", description="hexadecimal template; the map must begin with it")
    cell: Literal["int16", "uint16", "int32", "uint32", "float32", "float64"] = "int16"
    byte_order: Literal["big", "little"] = "big"
    unit: str = Field(description="of `scale` and `datum`: nm, um, mm or m")
    scale: Finite = Field(default=1.0, description="height that a step of 1 is")
    datum: Finite = Field(default=0.0, description="height that a reading of 0 is")
    fastest: Literal["x", "y"] = Field(default="y", description="axis along which neighbouring cells follow")
    invalid: int | Finite | None = Field(default=None, description="reading of a cell that was not seen; NaN never is")
    valid_bits: bool = Field(default=False, description="a bit for each cell follows, most significant first")


class StepBase(Table):
    """Keys that every step has."""

    limit_s: Limit = Field(default=60.0, description="seconds that the step may take")
    enables: tuple[Literal["lamp", "gate", "motion"], ...] = Field(
        default=(), strict=False, description="of the heartbeat, as long as the step lasts"
    )


class Acting(StepBase):
    """A step after which the layer may have changed."""

    acts: bool = Field(default=True, description="the journal of the run has it; false: to make it twice does no harm")


class Memory(StepBase):
    """A place of a peer's memory."""

    peer: str
    address: int | str = Field(default=0, description='number, or template such as "{layer}"')
    address_bytes: Literal[1, 2, 3, 4, 5] = 4
    size_bytes: Literal[1, 2, 3, 4] = 4
    check: Literal["none", "crc32"] = Field(default="none", description="CRC-32 (zlib) of all bytes with 0x37")


class Download(Memory, Acting):
    """0x34, 0x36, 0x37: the pattern goes to a peer."""

    do: Literal["download"]


class Upload(Memory):
    """0x35, 0x36, 0x37: the height map comes from a peer."""

    do: Literal["upload"]


class RoutineStep(Acting):
    """0x31 01; done when it is answered, "still busy" (0x78) extends. Never repeated."""

    do: Literal["routine"]
    peer: str
    routine: Identifier
    option: str = Field(default="", description="hexadecimal template")
    answer: str = Field(default="", description="hexadecimal template that its answer's record must begin with")


class Read(StepBase):
    """0x22, repeated until a number in the answer has its expected value."""

    do: Literal["read"]
    peer: str
    identifier: Identifier
    at: int = Field(default=0, ge=0, description="first byte of the number, big-endian")
    bytes: Bytes = 1
    expected: int | str = Field(description='number, or template such as "{layer}"')


class Send(Acting):
    """A frame with all its signals."""

    do: Literal["send"]
    message: str
    signals: dict[str, Value] = Field(default={}, description="in the units of the DBC")


class Wait(StepBase):
    """Wait until a frame received since the last action has the expected value."""

    do: Literal["wait"]
    message: str
    signal: str
    expected: Value
    unless: Value | None = Field(default=None, description="value that ends the run instead of the expected one")


SECTIONS = ("start", "printer", "profiler", "stop")
STEPS = ("download", "upload", "routine", "read", "send", "wait")
"""Values of `do`."""
Step = Annotated[Download | Upload | RoutineStep | Read | Send | Wait, Field(discriminator="do")]


class OutputTable(Table):
    """`[outputs.NAME]`: a signal as one more output, NaN until a frame brings it."""

    message: str
    signal: str
    unit: str | None = Field(default=None, description="of the output; default: that of the DBC")


class MappingFile(Table):
    """The whole file. `printer` and `profiler` are the steps of a layer and of a scan, each in order; `start` those of
    the beginning of a run, `stop` those of a person who stops the rig."""

    dbc: str = Field(description="file name, in the folder of the mapping file")
    strict: bool = Field(default=True, description="overlapping signals, or ones beyond their message, are errors")
    heartbeat: bool = Field(default=False, description="send MasterAlive, as inkloop's own nodes need it")
    peers: dict[str, Peer] = {}
    pattern: PatternTable | None = None
    map: MapTable | None = None
    start: tuple[Step, ...] = Field(default=(), strict=False)
    printer: tuple[Step, ...] = Field(default=(), strict=False)
    profiler: tuple[Step, ...] = Field(default=(), strict=False)
    stop: tuple[Step, ...] = Field(default=(), strict=False)
    outputs: dict[str, OutputTable] = {}

    @property
    def awaited(self) -> dict[str, dict[str, str]]:
        """Signals that a step waits for or an output shows, by message: signal -> its first place in the file."""
        found: dict[str, dict[str, str]] = {}
        for section in SECTIONS:
            for number, step in enumerate(getattr(self, section), 1):
                if isinstance(step, Wait):
                    found.setdefault(step.message, {}).setdefault(step.signal, f"{section} step {number}")
        for name, output in self.outputs.items():
            found.setdefault(output.message, {}).setdefault(output.signal, f"outputs.{name}")
        return found
