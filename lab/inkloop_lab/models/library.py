"""The C kernels of the models through ctypes (fmus/models/inkloop_models.h), and arrays of a grid for them: complete,
finite and in C order, or a clear error.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import FloatMap
from inkloop.component_errors import HEIGHT_MOST
from inkloop.files import c_library

VARIABLE = "INKLOOP_MODELS_LIB"
HEIGHT_COUNT = 10
_INTERFACE = 2  # MODELS_INTERFACE of inkloop_models.h
_SIZE, _INTEGER, _REAL = ctypes.c_size_t, ctypes.c_int32, ctypes.c_double
_GRID = (_SIZE, _SIZE)
REALS = ctypes.POINTER(ctypes.c_double)
INTEGERS = ctypes.POINTER(ctypes.c_int32)
SIZES = ctypes.POINTER(ctypes.c_size_t)


def _structure(name: str, *fields: tuple[Any, str]) -> Any:
    """The structure of this name in the headers of the kernels: types, each with the names of its fields."""
    declared = tuple((field, kind) for kind, names in fields for field in names.split())
    return type(name, (ctypes.Structure,), {"_fields_": declared})


FarInkStruct = _structure("FarInk", (_REAL * HEIGHT_COUNT, "h"))
CapStruct = _structure("SphericalCap", (_REAL, "base_radius height"))
CapSharesStruct = _structure("CapShares", (_REAL * 3, "volume area"))  # of the middle, a side and a corner
DropModelStruct = _structure(
    "DropModel",
    (_REAL, "height_scale mv_plus mv_minus ma_plus ma_minus"),
    (CapSharesStruct, "cap"),
    (ctypes.c_bool, "guard limit_gains"),
)
InkMapStruct = _structure("InkMap", (REALS, "substrate height area"), (_SIZE, "nx ny"))
FineSurfaceStruct = _structure("FineSurface", (_SIZE, "nx ny per_pitch"), (_REAL, "spacing"), (REALS, "height"))
LiquidStruct = _structure("Liquid", (_REAL, "droplet_volume contact_angle"), (ctypes.c_int, "form"))
VariationStruct = _structure(
    "VolumeVariation",
    (_REAL, "variation"),
    (ctypes.c_int, "kind"),
    (_REAL, "nozzle_variation"),
    (_INTEGER, "nozzle_pitch seed"),
)
_FINE = ctypes.POINTER(FineSurfaceStruct)
_ENTRY_POINTS = {
    "inkloop_droplet_volumes": (None, (*_GRID, ctypes.POINTER(VariationStruct), _INTEGER, REALS)),
    "inkloop_layer_pass": (
        _REAL,
        (*_GRID, REALS, REALS, INTEGERS, ctypes.POINTER(FarInkStruct), _INTEGER, REALS, _INTEGER),
    ),
    "inkloop_caps": (_REAL, (*_GRID, REALS, INTEGERS, ctypes.POINTER(CapStruct), _REAL, REALS)),
    "inkloop_cap_reach_max": (_INTEGER, ()),
    "inkloop_cap_shares": (None, (_REAL, _REAL, _REAL, ctypes.POINTER(CapSharesStruct))),
    "inkloop_add_drops": (
        None,
        (ctypes.POINTER(InkMapStruct), ctypes.POINTER(DropModelStruct), SIZES, _SIZE, REALS),
    ),
    "inkloop_base_radius": (_REAL, (_REAL, _REAL)),
    "inkloop_fine_size": (None, (_FINE, SIZES, SIZES, SIZES)),
    "inkloop_spread_cells": (None, (_FINE, REALS)),
    "inkloop_mean_cells": (None, (_FINE, REALS)),
    "inkloop_print_lines": (_INTEGER, (_FINE, ctypes.POINTER(LiquidStruct), REALS, _SIZE, _SIZE, REALS)),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded kernels. Raises InkloopError if they are not installed or cannot be loaded."""
    return c_library("inkloop_lab.models", "inkloop_models", VARIABLE, _INTERFACE, _ENTRY_POINTS)


def heights(values: ArrayLike, name: str = "height", most: float = HEIGHT_MOST) -> FloatMap:
    """A copy of the heights of a grid (nx, ny) [m], or of another map without that limit. Raises ValueError."""
    found = np.array(values, dtype=np.float64, order="C")
    if found.ndim != 2 or found.size == 0:
        raise ValueError(f"{name} has shape {found.shape}; needs (nx, ny), at least one cell")
    if not np.isfinite(found).all():
        raise ValueError(
            f"{name} is not finite in {np.count_nonzero(~np.isfinite(found))} cells; needs a height in all"
        )
    if np.abs(found).max() > most:
        raise ValueError(f"{name} reaches {np.abs(found).max():g}; needs heights in metres, within {most:g} m")
    return found


def pattern_of(values: ArrayLike, shape: tuple[int, int]) -> NDArray[np.int32]:
    """A pattern (nx, ny): 0 none, 1 material A, 2 material B. Raises ValueError."""
    found = np.asarray(values)
    if found.shape != shape:
        raise ValueError(f"pattern has shape {found.shape}; needs {shape}, that of the surface")
    if found.dtype.kind not in "biu":
        raise ValueError(f"pattern is {found.dtype}; needs whole numbers or booleans")
    wrong = np.argwhere((found < 0) | (found > 2))
    if wrong.size:
        i, j = (int(index) for index in wrong[0])
        raise ValueError(f"pattern is {found[i, j]} in cell ({i}, {j}); needs 0, 1 or 2")
    return np.ascontiguousarray(found, dtype=np.int32)


def volumes(values: ArrayLike | None, shape: tuple[int, int]) -> FloatMap:
    """Volume of each cell's droplet in nominal drops (nx, ny), all 1 if none are given. Raises ValueError."""
    if values is None:
        return np.ones(shape)
    found = np.array(values, dtype=np.float64, order="C")
    if found.shape != shape or not (np.isfinite(found) & (found >= 0.0)).all():
        raise ValueError(f"volume has shape {found.shape}; needs {shape}, all finite and at least 0")
    return found


def positive(**lengths: float) -> None:
    """Raises ValueError with every number that is not above 0."""
    wrong = [
        f"{name} is {value!r}; needs a number above 0" for name, value in lengths.items() if not 0 < value < np.inf
    ]
    if wrong:
        raise ValueError("; ".join(wrong))


def passes_of(passes: int, pass_order: int, pass_rotation: int) -> None:
    """Raises ValueError for an invalid number of passes."""
    if passes not in (1, 4) or pass_order not in (1, 2) or not 0 <= pass_rotation <= 3:
        raise ValueError(
            f"passes is {passes}, pass_order {pass_order}, pass_rotation {pass_rotation}; needs 1 or 4 passes in order "
            "1 (raster) or 2 (diagonal), rotated by 0 to 3 places"
        )


def reals(values: NDArray[np.float64]) -> Any:
    """Pointer to the numbers of a C-ordered array."""
    return values.ctypes.data_as(REALS)


def integers(values: NDArray[np.int32]) -> Any:
    """Pointer to the numbers of a C-ordered array."""
    return values.ctypes.data_as(INTEGERS)
