"""Load the C code of columns through ctypes (cosim/columns)."""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from typing import Any

import numpy as np
from numpy.ctypeslib import ndpointer
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.files import c_library

VARIABLE = "INKLOOP_COLUMNS_LIB"
_INTERFACE = 2  # COLUMNS_INTERFACE of columns.h
_SIZE, _POINTER = ctypes.c_size_t, ctypes.c_void_p
_INDICES = ndpointer(np.int64, flags="C_CONTIGUOUS")
_REALS = ndpointer(np.float64, flags="C_CONTIGUOUS")
_MARKS = ndpointer(np.bool_, flags="C_CONTIGUOUS")


class ColumnsStruct(ctypes.Structure):
    """`Columns` of columns.h."""

    _fields_ = (("offsets", _POINTER), ("bottom", _POINTER), ("top", _POINTER))

    @classmethod
    def of(cls, offsets: NDArray[np.int64], bottoms: FloatMap, tops: FloatMap) -> ColumnsStruct:
        """Of contiguous arrays, which must outlive it."""
        return cls(offsets.ctypes.data, bottoms.ctypes.data, tops.ctypes.data)


class IntervalListStruct(ctypes.Structure):
    """`IntervalList` of columns.h."""

    _fields_ = (("bottom", _POINTER), ("top", _POINTER), ("count", _SIZE), ("capacity", _SIZE))


class MeshReportStruct(ctypes.Structure):
    """`MeshReport` of mesh_columns.h."""

    _fields_ = (
        ("open", _POINTER),
        ("room", _SIZE),
        ("occupied", ctypes.c_int64),
        ("open_count", ctypes.c_int64),
        ("inside_out_count", ctypes.c_int64),
        ("inside_out_first", ctypes.c_int64),
        ("wound_height", ctypes.c_double),
    )


_COLUMNS = ctypes.POINTER(ColumnsStruct)
_LIST = ctypes.POINTER(IntervalListStruct)
_ENTRY_POINTS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "columns_release": (None, (_POINTER,)),
    "columns_check": (ctypes.c_int64, (_SIZE, _SIZE, _COLUMNS)),
    "columns_inside": (None, (_COLUMNS, _SIZE, _POINTER, _REALS, _MARKS)),
    "columns_union": (ctypes.c_int32, (_SIZE, _SIZE, _INDICES, _REALS, _REALS, _INDICES, _LIST)),
    "columns_combine": (ctypes.c_int32, (_SIZE, _COLUMNS, _COLUMNS, ctypes.c_int32, _INDICES, _LIST)),
    "columns_of_mesh": (
        ctypes.c_int32,
        (_SIZE, _SIZE, _SIZE, _REALS, ctypes.POINTER(MeshReportStruct), _INDICES, _LIST),
    ),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded code. Raises InkloopError if it is not installed or cannot be loaded."""
    return c_library("inkloop.geometry", "inkloop_columns", VARIABLE, _INTERFACE, _ENTRY_POINTS)


def intervals_by(function: str, cells: int, *arguments: Any) -> tuple[NDArray[np.int64], FloatMap, FloatMap]:
    """Offsets, bottoms and tops of the columns that a function makes from its arguments. Raises MemoryError."""
    offsets, intervals = np.empty(cells + 1, dtype=np.int64), IntervalListStruct()
    failed = getattr(library(), function)(*arguments, offsets, intervals)
    bottoms, tops = _owned(intervals.bottom, intervals.count), _owned(intervals.top, intervals.count)
    if failed:
        raise MemoryError(f"no memory for the intervals of {cells:,} columns")
    return offsets, bottoms, tops


def _owned(address: int | None, count: int) -> FloatMap:
    """NumPy array of memory of the library, which is released with the last array on it."""
    if address is None or count == 0:
        library().columns_release(address)
        return np.empty(0)
    memory = (ctypes.c_double * count).from_address(address)
    weakref.finalize(memory, library().columns_release, address).atexit = False
    return np.ctypeslib.as_array(memory)
