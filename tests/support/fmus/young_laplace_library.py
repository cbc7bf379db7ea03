"""The kernels of YoungLaplaceDeposition, compiled for the tests and loaded with ctypes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from support import compiled
from support.places import C_SOURCES, ROOT

KERNELS = ROOT / "fmus" / "young_laplace_deposition"
MODULES = ("banded_cholesky", "fine_surface", "footprint", "line_pass", "liquid_body", "wetted_nodes")
SOURCES = [KERNELS / f"{name}.c" for name in MODULES]
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
TRAPS = ("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error", "-ffp-contract=off")
LINEAR, NONLINEAR = 1, 2
PITCH, VOLUME, ANGLE = 42.3e-6, 30e-15, np.pi / 4

_Numbers = ctypes.POINTER(ctypes.c_double)


class FineSurface(ctypes.Structure):
    _fields_ = [
        ("nx", ctypes.c_size_t),
        ("ny", ctypes.c_size_t),
        ("per_pitch", ctypes.c_size_t),
        ("spacing", ctypes.c_double),
        ("height", _Numbers),
    ]


class Liquid(ctypes.Structure):
    _fields_ = [("droplet_volume", ctypes.c_double), ("contact_angle", ctypes.c_double), ("form", ctypes.c_int)]


class PassReport(ctypes.Structure):
    _fields_ = [("fallbacks", ctypes.c_int32), ("lost", ctypes.c_double)]


class Place(ctypes.Structure):
    _fields_ = [("x", ctypes.c_double), ("y", ctypes.c_double)]


@functools.cache
def library() -> ctypes.CDLL:
    """Undefined behaviour ends it."""
    flags = ("-std=c11", "-O2", *WARNINGS, *TRAPS, f"-I{KERNELS}")
    loaded = compiled.library("young_laplace.so", [*SOURCES, C_SOURCES / "young_laplace_probe.c"], flags)
    loaded.probe_print.restype = loaded.band_factor.restype = ctypes.c_bool
    loaded.cap_radius.restype = ctypes.c_double
    loaded.convex_hull.restype = ctypes.c_size_t
    return loaded


def numbers(values: Any) -> Any:
    """A pointer to the numbers of a C-ordered array."""
    return values.ctypes.data_as(_Numbers)


class Print:
    """A fine surface that is printed on; `height` (columns, rows) [m] includes the rim."""

    def __init__(self, nx: int, ny: int, per_pitch: int, form: int = NONLINEAR, pitch: float = PITCH) -> None:
        self.nx, self.ny, self.per_pitch = nx, ny, per_pitch
        self.rim = 2 * per_pitch + 2
        self.height = np.zeros((nx * per_pitch + 2 * self.rim, ny * per_pitch + 2 * self.rim))
        self.spacing = pitch / per_pitch
        self.surface = FineSurface(nx, ny, per_pitch, self.spacing, numbers(self.height))
        self.liquid = Liquid(VOLUME, ANGLE, form)
        self.fallbacks, self.lost = 0, 0.0

    def layer(self, drops: Any, passes: Sequence[tuple[int, int]] = ((0, 4), (1, 4), (2, 4), (3, 4))) -> None:
        """Print droplets (nx, ny), volumes in drops, in passes over (first line, every)."""
        drops = np.ascontiguousarray(drops, dtype=np.float64)
        assert drops.shape == (self.nx, self.ny)
        sizes = ctypes.c_size_t * len(passes)
        reports = (PassReport * len(passes))()
        assert library().probe_print(
            ctypes.byref(self.surface),
            ctypes.byref(self.liquid),
            numbers(drops),
            ctypes.c_size_t(len(passes)),
            sizes(*(p[0] for p in passes)),
            sizes(*(p[1] for p in passes)),
            reports,
        )
        self.fallbacks += sum(report.fallbacks for report in reports)
        self.lost += sum(report.lost for report in reports)

    @property
    def volume(self) -> float:
        """All that lies on the plane 0 [m3]."""
        return float(self.height.sum()) * self.spacing**2

    @property
    def cells(self) -> Any:
        """Cell means (nx, ny) [m]."""
        found = np.empty((self.nx, self.ny))
        library().mean_cells(ctypes.byref(self.surface), numbers(found))
        return found
