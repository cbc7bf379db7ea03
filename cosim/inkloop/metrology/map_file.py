"""Height maps from files: the format by the suffix, the unit and the pixel size by the file or by the caller.

Neither is ever guessed: a map that is wrong by a factor of 1000 looks like any other.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from inkloop.component import FloatMap
from inkloop.errors import HeightMapError, damaged, missing
from inkloop.files import regular
from inkloop.limits import memory_error, unpacked_error
from inkloop.metrology import map_readers
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_readers import PIXEL_TOLERANCE, FileContents, length_factor
from inkloop.metrology.table_file import read_table
from inkloop.units import M_PER_UM, UM_PER_M

__all__ = ["read"]

COPIES = 3
"""Times its size that reading an array takes: what is stored, the heights, and their transposed copy."""
FIELD_MIN, FIELD_MAX = M_PER_UM, 1.0
"""Width of a field that a profiler can have measured [m] (assumed); no larger are its heights."""
STEEPEST = 10.0
"""Range of nearly all heights over the width of the field, above which a unit must be wrong (assumed)."""
_NEARLY_ALL = (1.0, 99.0)  # percentiles


def _picture(path: Path) -> FileContents:
    from inkloop.metrology.picture_file import read_picture

    return read_picture(path)


def _single(read: Callable[[Path], FileContents]) -> Callable[[Path, str | None], FileContents]:
    """The reader of a format that holds one map."""

    def reading(path: Path, channel: str | None) -> FileContents:
        map_readers.chosen(path, ["the map"], channel)
        return read(path)

    return reading


_READERS: Mapping[str, tuple[Callable[[Path, str | None], FileContents], str]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".asc"), (_single(read_table), "")),
    **dict.fromkeys((".npy", ".npz"), (map_readers.read_array, "")),
    **dict.fromkeys((".tif", ".tiff"), (map_readers.read_tiff, "tifffile")),
    **dict.fromkeys((".png", ".bmp"), (_single(_picture), "PIL")),
    ".sdf": (_single(map_readers.read_sdf), "sdfio"),
}
"""Suffix -> reader, and the library of an extra that it needs; any other suffix is an instrument's own."""
_INSTRUMENTS = (map_readers.read_instrument, "SurfaceTopography")
_OWN = {
    ".toml": "is no height map but a scenario, or settings; name a map, or the folder of a run",
    ".nc": "is the result of a run; name its folder",
    ".json": "is no height map; name a map, or the folder of a run",
}
"""Suffix of files that no profiler writes -> what to name."""


def read(
    path: Path | str,
    *,
    unit: str | None = None,
    pixel: float | tuple[float, float] | None = None,
    scale: float | None = None,
    invalid_value: float | None = None,
    rows_along: Literal["x", "y"] | None = None,
    channel: str | None = None,
    profile: bool = False,
) -> HeightMap:
    """The map in a file: CSV, NPY, NPZ; with `inkloop[formats]` TIFF, PNG, BMP and SDF; with
    `inkloop[metrology]` SUR, X3P and some 40 more.

    unit: of the heights, "nm", "um", "mm" or "m"; pixel: size, or (dx, dy) [m]; both may be left to a file that states
    them, and may not contradict it, unless what it states cannot be. scale: height of one count in `unit`, for files of
    whole-number counts. invalid_value: the number that marks a pixel without a height, as stored. rows_along: "x" where
    a stored row lies along x (default of tables and pictures), "y" where the first index goes along x (default of NPY
    and NPZ). channel: name or number of one of several maps. profile: whether a profile is read too, as (n, 1). Raises
    HeightMapError with all errors, which name pixel and scale `pixel_um` and `count_scale`, as scenarios do.
    """
    path = Path(path)
    contents = _contents(path, channel)
    errors: list[str] = []
    z = _heights(contents, scale, invalid_value, profile, errors)
    if (rows_along or contents.rows_along) == "x" and contents.values.ndim > 1:
        z = z.T
    dx, dy = _pixel(contents, pixel, z.shape, errors)
    widest = max(z.shape[0] * dx, z.shape[-1] * dy)
    declared, factor = _unit(contents, unit, z, widest, errors)
    if not errors:
        z *= factor
        errors += filter(None, [_field_error(widest), _height_error(z, widest)])
    if errors:
        raise HeightMapError(f"{path}{contents.channel and f', {contents.channel}'}: " + "; ".join(errors))
    remark = ", ".join(filter(None, (contents.channel, f"stored in {declared}")))
    return HeightMap(z, dx, dy, source=str(path), remark=remark)


def _heights(
    contents: FileContents, scale: float | None, invalid_value: float | None, profile: bool, errors: list[str]
) -> FloatMap:
    """The values (m, n) as float64 in the unit of the heights, NaN where there is none."""
    values = np.asarray(contents.values)
    before = len(errors)
    if values.ndim == 1 and not profile:
        errors.append(
            f"holds a profile of {values.size} heights and no map; `inkloop metrology --profile` evaluates it"
        )
    elif values.ndim not in (1, 2):
        errors.append(f"holds an array of shape {values.shape}; expected rows and columns")
    elif values.dtype.kind not in "iuf":
        errors.append(f"holds values of type {values.dtype}; expected numbers")
    elif values.dtype.kind in "iu" and scale is None:
        errors.append(
            f"holds whole-number counts ({values.dtype}); give count_scale (--count-scale), the height of one count in "
            "the unit"
        )
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        errors.append(f"count_scale is {scale}; expected a height per count above 0")
    if reason := memory_error(2 * 8 * values.size):
        errors.append(f"holds {values.size:,} pixels: {reason}")
    if len(errors) > before:
        return np.full((1, 1), np.nan)
    with np.errstate(invalid="ignore"):  # of NaN that signal
        z = values.astype(np.float64)
    for invalid in (invalid_value, contents.invalid):
        if invalid is not None:
            z[np.equal(values, values.dtype.type(invalid) if values.dtype.kind == "f" else invalid)] = np.nan
    z[~np.isfinite(z)] = np.nan
    z *= 1.0 if scale is None else scale
    return z[:, None] if z.ndim == 1 else z


def library_error(path: Path) -> str:
    """A sentence that names the package which the format of a file needs, if that is not installed; else ""."""
    library = _READERS.get(path.suffix.lower(), _INSTRUMENTS)[1]
    return missing(library, f"{path}: a height map in this format") if library else ""


def _contents(path: Path, channel: str | None) -> FileContents:
    try:
        if reason := _size_error(path):
            raise HeightMapError(f"{path}: {reason}; save a part of the map, or fewer pixels")
        if own := _OWN.get(path.suffix.lower()):
            raise HeightMapError(f"{path}: {own}")
        if reason := library_error(path):
            raise HeightMapError(reason)
        return _READERS.get(path.suffix.lower(), _INSTRUMENTS)[0](path, channel)
    except HeightMapError:
        raise
    except OSError as error:
        raise HeightMapError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:  # each library fails in its own way on bytes that are cut off or altered
        raise HeightMapError(damaged(path)) from error


def _size_error(path: Path) -> str | None:
    """The reason why a file is too large: its unpacked size. NPZ and X3P are archives."""
    unpacked = regular(path).stat().st_size
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            if reason := unpacked_error(archive):
                return reason
            unpacked = sum(member.file_size for member in archive.infolist())
    return memory_error(unpacked * COPIES)


def _unit(contents: FileContents, unit: str | None, z: FloatMap, widest: float, errors: list[str]) -> tuple[str, float]:
    """The unit of the stored heights, and metres in it; file and option must agree, unless the file's cannot be."""
    declared = contents.unit if contents.unit is not None else unit
    factor = None if declared is None else length_factor(declared)
    asked = None if unit is None else length_factor(unit)
    if unit is not None and asked is None:
        errors.append(f"unit is {unit!r}; expected one of nm, um, mm, m")
    elif declared is None:
        errors.append("does not declare the unit of its heights; give unit (--unit): nm, um, mm or m")
    elif factor is None:
        errors.append(f"the unit of its heights is {declared!r}; expected one of nm, um, mm, m")
    elif unit is not None and asked is not None and asked != factor:
        if _height_error(z * factor, widest):
            return unit, asked
        errors.append(f"declares heights in {contents.unit}, but unit is {unit!r}; leave unit out or correct it")
    return str(declared), factor or 1.0


def _pixel(
    contents: FileContents, pixel: float | tuple[float, float] | None, shape: tuple[int, ...], errors: list[str]
) -> tuple[float, float]:
    """Size of a pixel along x and y [m]; file and option must agree, unless the file's cannot be."""
    asked = (float(pixel), float(pixel)) if isinstance(pixel, int | float) else pixel
    if asked is None and contents.pixel is None:
        errors.append("does not declare the size of its pixels; give pixel_um (--pixel-um), the distance of two pixels")
    if asked is not None and not all(np.isfinite(size) and size > 0 for size in asked):
        errors.append(f"pixel_um is {_um(asked)}; expected lengths above 0")
        return 1.0, 1.0
    if asked and contents.pixel and not np.allclose(asked, contents.pixel, rtol=PIXEL_TOLERANCE, atol=0.0):
        if _field_error(max(count * size for count, size in zip(shape, contents.pixel, strict=True))):
            return asked
        declared = " x ".join(f"{size * UM_PER_M:g}" for size in contents.pixel)
        errors.append(f"declares pixels of {declared} µm, but pixel_um is {_um(asked)}; leave it out or correct it")
    return contents.pixel or asked or (1.0, 1.0)


def _field_error(widest: float) -> str | None:
    """The reason why no profiler can have measured a field of this width [m]."""
    if FIELD_MIN <= widest <= FIELD_MAX:
        return None
    return (
        f"its field is {widest * UM_PER_M:g} µm wide; expected {FIELD_MIN * UM_PER_M:g} µm to {FIELD_MAX:g} m: give "
        "pixel_um (--pixel-um), the right distance of two pixels"
    )


def _height_error(z: FloatMap, widest: float) -> str | None:
    """The reason why no surface of this width [m] can have these heights [m]."""
    known = z[np.isfinite(z)]
    if not known.size:
        return None
    low, high = np.percentile(known, _NEARLY_ALL)
    if np.ptp(known) <= FIELD_MAX and high - low <= STEEPEST * widest:
        return None
    lowest, highest = float(known.min()), float(known.max())  # of floats products overflow without a warning
    return (
        f"its heights reach from {lowest * UM_PER_M:g} to {highest * UM_PER_M:g} µm on a field "
        f"{widest * UM_PER_M:g} µm wide; give unit (--unit), the right one, or invalid_value (--invalid-value), the "
        "number of a pixel without a height"
    )


def _um(sizes: tuple[float, float]) -> str:
    """Lengths in the form of `pixel_um`: one number, or two."""
    return " x ".join(f"{size * UM_PER_M:g}" for size in dict.fromkeys(sizes))
