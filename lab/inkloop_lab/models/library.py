"""Load the C kernels of the models through ctypes (fmus/models/inkloop_models.h)."""

from __future__ import annotations

import ctypes
from functools import cache

from inkloop.files import c_library

VARIABLE = "INKLOOP_MODELS_LIB"
HEIGHT_COUNT = 10
_INTERFACE = 2  # MODELS_INTERFACE of inkloop_models.h
_SIZE, _INTEGER, _REAL = ctypes.c_size_t, ctypes.c_int32, ctypes.c_double
_GRID = (_SIZE, _SIZE)
REALS = ctypes.POINTER(ctypes.c_double)
INTEGERS = ctypes.POINTER(ctypes.c_int32)
SIZES = ctypes.POINTER(ctypes.c_size_t)


class FarInkStruct(ctypes.Structure):
    """`FarInk` of far_neighbours.h."""

    _fields_ = (("h", _REAL * HEIGHT_COUNT),)


class CapStruct(ctypes.Structure):
    """`SphericalCap` of spherical_cap.h."""

    _fields_ = (("base_radius", _REAL), ("height", _REAL))


class CapSharesStruct(ctypes.Structure):
    """`CapShares` of propagation.h: middle, side and corner."""

    _fields_ = (("volume", _REAL * 3), ("area", _REAL * 3))


class DropModelStruct(ctypes.Structure):
    """`DropModel` of propagation.h."""

    _fields_ = (
        ("height_scale", _REAL),
        ("mv_plus", _REAL),
        ("mv_minus", _REAL),
        ("ma_plus", _REAL),
        ("ma_minus", _REAL),
        ("cap", CapSharesStruct),
        ("guard", ctypes.c_bool),
        ("limit_gains", ctypes.c_bool),
    )


class InkMapStruct(ctypes.Structure):
    """`InkMap` of propagation.h."""

    _fields_ = (("substrate", REALS), ("height", REALS), ("area", REALS), ("nx", _SIZE), ("ny", _SIZE))


class FineSurfaceStruct(ctypes.Structure):
    """`FineSurface` of fine_surface.h."""

    _fields_ = (("nx", _SIZE), ("ny", _SIZE), ("per_pitch", _SIZE), ("spacing", _REAL), ("height", REALS))


class LiquidStruct(ctypes.Structure):
    """`Liquid` of line_pass.h."""

    _fields_ = (("droplet_volume", _REAL), ("contact_angle", _REAL), ("form", ctypes.c_int))


class VariationStruct(ctypes.Structure):
    """`VolumeVariation` of droplet_volume.h."""

    _fields_ = (
        ("variation", _REAL),
        ("kind", ctypes.c_int),
        ("nozzle_variation", _REAL),
        ("nozzle_pitch", _INTEGER),
        ("seed", _INTEGER),
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
