"""`[[bench.faults]]` and `inkloop bench emulate --fault`: faults injected into the emulator."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from inkloop.errors import InkloopError
from inkloop.tables.messages import sentence
from inkloop.tables.shapes import Table

KINDS = Literal[
    "loss",
    "burst",
    "corruption",
    "duplication",
    "swap",
    "delay",
    "flow-control",
    "malformed-line",
    "transmit-order",
    "short-queue",
    "stuck-counter",
    "bad-check",
    "late-answer",
    "repeated-answer",
    "short-map",
    "reboot",
    "death",
    "hang",
    "slow-erase",
    "unreadable",
    "broken",
    "second-master",
    "unplugged",
    "bus-off",
]
Parts = Literal[
    "gate-stays-open",
    "gate-stays-closed",
    "lamp-stays-on",
    "not-ready",
    "work-fails",
    "work-hangs",
    "storage-full",
    "lamp-stays-off",
    "end-switches",
]
Count = Annotated[int, Field(ge=1, lt=2**32)]
NEEDS_NODE = ("reboot", "death", "hang", "slow-erase", "unreadable")


class FaultTable(Table):
    """One fault of the emulator. Frames and steps are counted, never time: the same ones are hit again."""

    kind: KINDS = Field(description="what goes wrong")
    probability: float | None = Field(default=None, gt=0.0, le=1.0, description="of each frame or answer that fits")
    nth: Count | None = Field(default=None, description="once, at the nth frame or answer that fits")
    count: Count | None = Field(default=None, description="so many in a row; records that cannot be read")
    frames: Count | None = Field(
        default=None,
        description="frames that overtake a delayed one, that fit into a queue; MasterAlive frames that an event lasts",
    )
    way: Literal["to-nodes", "from-nodes"] | None = Field(default=None, description="only frames on this way")
    id: int | None = Field(default=None, ge=0, le=0x7FF, description="only frames with this arbitration id")
    node: Literal["head", "stage", "cure", "profiler"] | None = Field(
        default=None, description="only frames and answers of this node; the node that it happens to"
    )
    service: int | None = Field(default=None, ge=0, le=0xBF, description="only answers to this service")
    byte: int | None = Field(default=None, ge=0, le=7, description="the byte of the frame that is altered")
    part: Parts | None = Field(default=None, description="the part that breaks")
    layer: int | None = Field(default=None, ge=0, le=65535, description="from the first step of this layer on")
    pass_: int | None = Field(
        default=None, alias="pass", ge=0, le=3, description="from the first step of this pass on, counted from 0"
    )
    step: Literal["home", "move", "purge", "pass", "cure", "scan", "self-test", "download", "upload"] | None = Field(
        default=None, description="from the first step of this kind on"
    )
    seed: int | None = Field(default=None, ge=0, lt=2**31, description="of the draws of this fault")

    @model_validator(mode="after")
    def _fits_together(self) -> FaultTable:
        if self.probability is not None and self.nth is not None:
            raise ValueError("expected probability, or nth, not both")
        if self.kind in NEEDS_NODE and self.node is None:
            raise ValueError(f"kind = {self.kind!r} needs node as well")
        if self.kind == "broken" and self.part is None:
            raise ValueError("kind = 'broken' needs part as well")
        return self

    def __str__(self) -> str:
        """As `inkloop bench emulate --fault` and the program of the nodes take it."""
        found = self.model_dump(by_alias=True, exclude_none=True, exclude={"kind"})
        pairs = ",".join(f"{key}={value}" for key, value in found.items())
        return f"{self.kind}:{pairs}" if pairs else self.kind


def read_fault(text: str) -> FaultTable:
    """A fault from KIND[:key=value,...]. Raises InkloopError with all its errors."""
    kind, _, rest = text.partition(":")
    pairs = [pair.partition("=") for pair in rest.split(",") if pair]
    values: dict[str, object] = {"kind": kind} | {key: _value(word) for key, _, word in pairs}
    try:
        return FaultTable.model_validate(values)
    except ValidationError as error:
        faults = [sentence(detail, FaultTable) for detail in error.errors()]
    raise InkloopError(f"--fault {text}: " + "; ".join(fault.lstrip() for fault in faults))


def _value(word: str) -> object:
    for number in (lambda: int(word, 0), lambda: float(word)):
        try:
            return number()
        except ValueError:
            continue
    return word
