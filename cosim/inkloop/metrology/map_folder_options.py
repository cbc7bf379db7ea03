"""The options of a `MapFolder` in a scenario: type, limits and meaning of each."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from inkloop.metrology.datum import Datum
from inkloop.metrology.folder_watch import Complete
from inkloop.metrology.height_map import Mirror
from inkloop.metrology.placement import Method

_Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Point = Annotated[list[_Finite], Field(min_length=2, max_length=2)]
_ASKED = "required if the file does not give it, and it may not contradict the file"

Folder: TypeAlias = Annotated[str, Field(description="folder that the profiler writes to, relative to the scenario")]
FileName: TypeAlias = Annotated[
    str,
    Field(description="file name of a layer, whose suffix gives the format; layer 0 is the surface before the print"),
]
Unit: TypeAlias = Annotated[
    Literal["nm", "um", "mm", "m"] | None, Field(description=f"of the heights, nm, um, mm or m; {_ASKED}")
]
Pixel: TypeAlias = Annotated[_Positive | None, Field(description=f"pixel spacing; {_ASKED}")]
CountScale: TypeAlias = Annotated[
    _Positive | None, Field(description="height of one count, in `unit`: for files of integer counts")
]
InvalidValue: TypeAlias = Annotated[
    _Finite | None, Field(description="number that marks a pixel without a height; none: every pixel has one")
]
Channel: TypeAlias = Annotated[
    str | None, Field(description="name or number of one of several maps in a file; none: the only or default one")
]
RowsAlong: TypeAlias = Annotated[
    Literal["x", "y"] | None,
    Field(
        description='"x": a stored row lies along x, as in tables and pictures; "y": the first index goes along x, as '
        "in NPY and NPZ; none: as the format has it"
    ),
]
Registered: TypeAlias = Annotated[
    Method,
    Field(
        description='"given": by offset and rotation; "fiducials": by points seen on the map; "fit": by the outline of '
        "the part, starting from offset and rotation"
    ),
]
OffsetX: TypeAlias = Annotated[_Finite, Field(description="position of the map's first pixel on the grid, along x")]
OffsetY: TypeAlias = Annotated[_Finite, Field(description="the same along y")]
Rotation: TypeAlias = Annotated[_Finite, Field(description="of the map on the grid, counterclockwise from x to y")]
Mirrored: TypeAlias = Annotated[
    Mirror,
    Field(
        description='"x" or "y": that coordinate of the map is reversed; "y" for pictures whose first row is at the top'
    ),
]
FiducialsOnMap: TypeAlias = Annotated[
    list[_Point] | None, Field(description="two or more points `[[x, y], ...]` on the map")
]
FiducialsOnGrid: TypeAlias = Annotated[
    list[_Point] | None, Field(description="the same points on the grid, in the same order")
]
ResidualMax: TypeAlias = Annotated[
    _Positive | None,
    Field(description="largest residual (rms) of the fiducials, a worse fit is refused; none: a tenth of the pitch"),
]
FitReach: TypeAlias = Annotated[
    _Positive | None, Field(description="search range of the fit around the given offset; none: 3 cells")
]
FitReachAngle: TypeAlias = Annotated[
    float, Field(ge=0.0, le=45.0, description="search range of the fit around the given rotation")
]
ValidShareMin: TypeAlias = Annotated[
    float, Field(gt=0.0, le=1.0, description="smallest measured share of a valid cell")
]
Levelled: TypeAlias = Annotated[
    Datum,
    Field(
        description='"offset" or "plane": subtract the offset or plane seen on the cells around the part, for '
        "profilers that lose height or tilt between scans"
    ),
]
DatumMargin: TypeAlias = Annotated[
    int, Field(ge=1, description="cells around the part that the datum does not use: a droplet reaches one cell")
]
Completion: TypeAlias = Annotated[
    Complete,
    Field(
        description='a file is complete when it is unchanged for `settle_s` ("stable"), when it gets its name '
        '("renamed"), or when a file of its name plus `.done` exists ("done")'
    ),
]
Settling: TypeAlias = Annotated[
    float, Field(ge=0.0, allow_inf_nan=False, description='time without a change, for `complete` = "stable"')
]
Timeout: TypeAlias = Annotated[
    _Positive, Field(description="longest wait for a file, by the wall clock, before the run ends")
]
Replay: TypeAlias = Annotated[
    bool,
    Field(description="use recorded maps: files may exist before their layer is printed, and may be equal"),
]
