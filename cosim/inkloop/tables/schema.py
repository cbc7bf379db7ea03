"""The scenario file as a set of tables: every key with its type, limits, default and meaning.

The keys of a file carry units (`pitch_um`); here and in `inkloop.tables.shapes` they become SI. Keys of
`[components.NAME]` depend on its `kind` and are checked by `inkloop.components.catalog`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from inkloop.component import Ink
from inkloop.component_errors import INK_MOST
from inkloop.master.orientation import Mirrored, Transposed
from inkloop.tables import bench_faults
from inkloop.tables.metrology import MetrologyTable
from inkloop.tables.part import Part
from inkloop.tables.shapes import Grid, Length, SubstrateTable, Table
from inkloop.units import M_PER_UM, UM_PER_M

__all__ = ["Inks", "Process"]


class Support(Table):
    """`[support]`: regions where material B holds the part, since a droplet cannot hang."""

    kind: Literal["around", "below-overhangs", "none"] = Field(
        default="around",
        description="the block around the part, up to its height; only what is empty below overhangs; or nothing: of "
        "each cell only what rests on the substrate is printed",
    )
    margin_cells: int = Field(default=2, ge=0, description="empty cells kept along the edge of the grid")


_INK_MOST_UM = INK_MOST * UM_PER_M
_InkHeight = Annotated[float, Field(ge=0.0, le=_INK_MOST_UM, allow_inf_nan=False)]


class InkTable(Table):
    """`[ink.a]`, `[ink.b]`: heights added by one droplet; defaults of Lu et al. 2015, Table I."""

    h1_um: Length = Field(default=4.4, le=_INK_MOST_UM, description="height added to the hit cell")
    h2_um: _InkHeight = Field(default=0.6, description="height added to a side neighbour")
    h3_um: _InkHeight = Field(default=0.2, description="height added to a corner neighbour")

    @property
    def ink(self) -> Ink:
        """The ink in SI."""
        return Ink(self.h1_um * M_PER_UM, self.h2_um * M_PER_UM, self.h3_um * M_PER_UM)

    @property
    def remarks(self) -> list[str]:
        """Warnings, each of which begins with a key."""
        name, neighbour = max(("h2_um", self.h2_um), ("h3_um", self.h3_um), key=lambda each: each[1])
        if self.h1_um >= neighbour:
            return []
        found = f"h1_um is {self.h1_um:g}, less than {name}, {neighbour:g}"
        return [f"{found}: a droplet adds less to its own cell than to a neighbour; check the unit, all are in µm"]


class Inks(Table):
    """`[ink]`: materials A and B."""

    file: str | None = Field(default=None, description="ink file, relative to the scenario; keys of this table win")
    a: InkTable = InkTable()
    b: InkTable | None = None

    @property
    def remarks(self) -> list[str]:
        """Warnings, each of which begins with the key."""
        inks = {"a": self.a} | ({"b": self.b} if self.b else {})
        return [f"ink.{name}.{remark}" for name, ink in inks.items() for remark in ink.remarks]


class Process(Table):
    """`[process]`: how a layer is laid down, the same for the plant and for the controller's model."""

    passes: Literal[1, 4] = Field(default=1, description="4: a 2x2 colouring with cure between the passes")
    pass_order: Literal["raster", "diagonal"] = "raster"
    pass_rotation: int = Field(default=0, ge=0, le=3, description="places by which each layer's order starts later")


class BenchTable(Table):
    """`[bench]`: the CAN bus that devices share, and what a layer on them needs besides its pattern.

    Without `interface` and `channel`, python-can's own configuration selects the bus.
    """

    interface: str | None = Field(default=None, description='of python-can: "socketcan", "slcan", "pcan", ...')
    channel: str | Annotated[int, Field(ge=0)] | None = Field(
        default=None, description='"can0", "/dev/ttyACM0", "socket://127.0.0.1:28550", 0, ...'
    )
    bitrate: int | None = Field(default=None, ge=10_000, le=1_000_000, description="bit/s")
    data_bitrate: int | None = Field(default=None, ge=10_000, le=8_000_000, description="bit/s of the data of CAN FD")
    bit_rate_switch: bool = Field(default=False, description="the data of sent CAN FD frames travel at `data_bitrate`")
    options: dict[str, Any] = Field(default={}, description="further options of the python-can interface")
    traffic_log: str = Field(
        default="traffic.blf",
        pattern=r"^([^/\\]+\.(blf|asc))?$",
        description="file in the run folder with all frames, .blf or .asc; empty: none",
    )
    cure_ms: int = Field(default=100, ge=1, le=65534, description="light after each pass")
    valid_share: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.5, description="share of cells that the first scan of a print, or of a dry run, must see"
    )
    on_part: bool = Field(default=False, description="the bed may carry a part when a print begins; also `--on-part`")
    loop_timeout_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = Field(
        default=120.0, description="silence of the control loop, with nothing enabled, after which its heartbeat stops"
    )
    grace_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = Field(
        default=0.5, description="silence of the control loop, with something enabled, after which its heartbeat stops"
    )
    answer_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = Field(
        default=1.0, description="time for a node to begin an answer; then the request is repeated, six tries in all"
    )
    silence_s: Annotated[float, Field(ge=0.1, le=60.0)] = Field(
        default=0.3, description="silence of a node after which it is lost; of other masters, before this one begins"
    )
    faults: list[bench_faults.FaultTable] = Field(default=[], description="faults that the emulator injects")

    def found_from(self, folder: Path) -> BenchTable:
        """The table of a scenario in `folder` with the file of its FMU, if one is the bus, as found from here."""
        if self.interface != "inkloop_fmu" or not isinstance(self.channel, str):
            return self
        return self.model_copy(update={"channel": str(folder / self.channel)})


class RunTable(Table):
    """`[run]`: communication points and the end of the run."""

    step_s: Annotated[float, Field(ge=1e-9, allow_inf_nan=False)] = Field(default=1.0, description="communication step")
    algorithm: Literal["gauss-seidel", "jacobi"] = "gauss-seidel"
    layers_max: int = Field(default=1000, ge=1, description="layers after which the run ends in any case")
    time_max_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    real_time_factor: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = Field(
        default=None, description="seconds of the run per second of the clock; left out: as fast as possible"
    )


class ComponentTable(BaseModel):
    """`[components.NAME]`: `kind`, and the options of that kind."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, defer_build=True)
    kind: str = Field(description="a kind of the catalog")

    @property
    def options(self) -> dict[str, Any]:
        """Everything but the kind."""
        return dict(self.model_extra or {})


class ConnectionTable(BaseModel):
    """`[[connections]]`: "component.port" to "component.port"; overrides the contract's wiring of that input.

    Besides these keys: `offset`, with the unit in the key where the input has one.
    """

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, defer_build=True)
    source: str
    target: str
    gain: Annotated[float, Field(allow_inf_nan=False)] | None = Field(
        default=None, description="factor on the way; also converts units that are not known here"
    )
    mirror: Mirrored = "none"
    transpose: Transposed = False

    @property
    def quantities(self) -> dict[str, Any]:
        """The keys that carry a unit."""
        return dict(self.model_extra or {})


class BusTable(Table):
    """`[[buses]]`: two buses of FMUs (FMI-LS-BUS) that are one."""

    between: list[str] = Field(description='two of "component.bus": two nodes, or a node and a bus simulation')


class EventTable(BaseModel):
    """`[[events]]`: a change to what a component gives or gets, from a layer or a time on.

    Besides these keys: `value`, and for a bias `per_layer`, with the unit in the key where the port has one.
    """

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, defer_build=True)
    at_layer: int | None = Field(default=None, ge=1, description="from the layer commanded with this number on")
    at_time_s: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = Field(
        default=None, description="from the step that begins then on"
    )
    action: Literal["override", "bias", "reset"] = Field(
        description="replace the value, add to it, or take back what earlier events of the file do"
    )
    port: str = Field(description='"component.port", an input or an output')
    tilt_x: Annotated[float, Field(allow_inf_nan=False)] = Field(default=0.0, description="bias: slope along x")
    tilt_y: Annotated[float, Field(allow_inf_nan=False)] = Field(default=0.0, description="bias: slope along y")
    cells: list[Annotated[list[int], Field(min_length=2, max_length=2)]] | None = Field(
        default=None, description="only these cells, each [i, j]"
    )
    nozzles: list[int] | None = Field(default=None, description="only the cells of these nozzles")

    @property
    def quantities(self) -> dict[str, Any]:
        """The keys that carry a unit."""
        return dict(self.model_extra or {})


class Comparison(Table):
    """`[compare.NAME]`: the same job printed again with other components."""

    components: dict[str, ComponentTable] = Field(description="components to put in place of those of the same name")


class Literature(Table):
    """`[literature.NAME]`: Published figures that the table shows next to the results."""

    mean_error_um: float | None = None
    std_um: float | None = None
    note: str = "another plant"


class ScenarioFile(Table):
    """The whole file."""

    schema_version: Literal[1] = 1
    title: str = Field(description="what the table and the pictures are called")
    label: str = Field(default="this run", description="short name of the run in the table and in legends")
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    grid: Grid
    part: Part
    substrate: SubstrateTable | None = None
    support: Support | None = None
    ink: Inks = Inks()
    process: Process = Process()
    run: RunTable = RunTable()
    metrology: MetrologyTable | None = None
    bench: BenchTable = BenchTable()
    components: dict[str, ComponentTable] = Field(min_length=1)
    connections: list[ConnectionTable] = Field(default=[])
    buses: list[BusTable] = Field(default=[])
    events: list[EventTable] = Field(default=[])
    compare: dict[str, Comparison] = Field(default={})
    literature: dict[str, Literature] = Field(default={})
