"""Contents of height map files before the caller's options complete them: NumPy, TIFF, SDF, formats of instruments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from zipfile import BadZipFile, ZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import HeightMapError
from inkloop.limits import XmlError, check_xml, memory_error, parsed_xml
from inkloop.units import M_PER_CM, M_PER_PM, SUFFIXES, UM_PER_M

if TYPE_CHECKING:
    from xml.etree import ElementTree

    import tifffile

_METRES = {**SUFFIXES["m"], "pm": M_PER_PM, "cm": M_PER_CM}
_SPELLINGS = {"\u00b5m": "um", "\u03bcm": "um", "micron": "um", "microns": "um"}  # micro sign, Greek mu
_HEIGHTS = ("z", "height")
_CENTIMETRE = 3  # TIFF 6.0, tag 296; 2 is the inch, in which picture programs write 72 or 300 without meaning it
_PACKED_AT_MOST = 10_000  # bytes from one byte; deflate makes 1032, other methods some more of an even surface
_Pixel = tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class FileContents:
    """Values as stored, with the statements of the file about them, None where it has none.

    values: 2-D, numbers in `unit`, NaN where nothing was measured; pixel: (dx, dy) [m]; rows_along: the coordinate that
    a stored row lies along: "x" where the first index goes along y, as in pictures and tables, "y" where it goes along
    x, as inkloop's own arrays do; remark: what a library took from the file, for a person.
    """

    values: NDArray[Any]
    unit: str | None = None
    pixel: _Pixel = None
    rows_along: Literal["x", "y"] = "x"
    remark: str = ""


def length_factor(unit: str) -> float | None:
    """Metres in a unit of length as files spell it, None if it is none."""
    plain = unit.strip()
    return _METRES.get(_SPELLINGS.get(plain, plain))


def pixel_of(sizes: Mapping[str, float]) -> _Pixel:
    """dx and dy of the sizes "dx", "dy" and "both" [m], None where one of the two is unknown."""
    dx, dy = (sizes.get(name, sizes.get("both")) for name in ("dx", "dy"))
    return None if dx is None or dy is None else (dx, dy)


def read_array(path: Path) -> FileContents:
    """An NPY file, or an NPZ file with `z_um` or `height_m` ... and `pixel_um`, or `dx_um` and `dy_um`.

    In an NPZ the unit stands in the key; a key without one (`z`, or the only 2-D array) leaves it to the caller.
    Raises HeightMapError, OSError.
    """
    try:
        loaded = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, BadZipFile) as error:
        raise HeightMapError(f"{path}: is no array of numbers that NumPy saved ({error})") from error
    if isinstance(loaded, np.ndarray):
        return FileContents(loaded, rows_along="y")
    with loaded:
        arrays = {name: loaded[name] for name in loaded.files}
    key, unit = _heights(path, arrays)
    sizes = {
        name: float(arrays[f"{key}_{suffix}"]) * factor
        for name, key in (("both", "pixel"), ("dx", "dx"), ("dy", "dy"))
        for suffix, factor in SUFFIXES["m"].items()
        if f"{key}_{suffix}" in arrays and arrays[f"{key}_{suffix}"].size == 1
    }
    return FileContents(arrays[key], unit, pixel_of(sizes), rows_along="y")


def _heights(path: Path, arrays: dict[str, np.ndarray]) -> tuple[str, str | None]:
    """Key of the heights and the unit in its name."""
    keys = {f"{name}_{suffix}": suffix for name in _HEIGHTS for suffix in SUFFIXES["m"]} | dict.fromkeys(_HEIGHTS)
    named = [(key, unit) for key, unit in keys.items() if key in arrays]
    found = named or [(name, None) for name, array in arrays.items() if array.ndim == 2]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "nothing"
    raise HeightMapError(f"{path}: holds {listed}; expected one map, named z_um, height_um or z")


def read_sdf(path: Path) -> FileContents:
    """A surface of ISO 25178-71, as text or binary. Raises HeightMapError, OSError."""
    import sdfio

    try:
        surface = sdfio.read(path)
    except (sdfio.SdfError, ValueError) as error:
        raise HeightMapError(f"{path}: is no SDF file as ISO 25178-71 has it ({error})") from error
    pixel = float(surface.header.x_scale), float(surface.header.y_scale)
    return FileContents(np.asarray(surface.data, np.float64), "m", pixel)


def read_instrument(path: Path) -> FileContents:
    """The default channel of a file of an instrument: SUR, X3P, GWY, VK, OPD ... Raises HeightMapError, OSError."""
    from SurfaceTopography import open_topography

    try:
        if is_zipfile(path):  # X3P
            with ZipFile(path) as archive, archive.open("main.xml") as file:
                check_xml(file)
        reader = open_topography(str(path))
        channel, topography = reader.default_channel, reader.topography()
        heights = np.ma.filled(topography.heights().astype(np.float64), np.nan)
        unit, sizes = topography.unit, topography.physical_sizes
    except Exception as error:  # each of its readers fails in its own way, on bytes of unknown origin
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise HeightMapError(f"{path}: SurfaceTopography cannot read it ({reason})") from error
    if heights.ndim != 2:
        raise HeightMapError(f"{path}: holds a line of {heights.size} heights; expected a map")
    remark = f"channel {channel.name} of {len(reader.channels)}, heights in {unit or 'no unit'}"
    factor = None if unit is None else length_factor(str(unit))
    if factor is None or sizes is None:
        return FileContents(heights, unit, rows_along="y", remark=f"{remark}, a field of no size")
    field = [float(size) * factor for size in sizes]
    pixel = field[0] / heights.shape[0], field[1] / heights.shape[1]
    remark += f", a field of {field[0] * UM_PER_M:.6g} x {field[1] * UM_PER_M:.6g} µm"
    return FileContents(heights, unit, pixel, rows_along="y", remark=remark)


def read_tiff(path: Path) -> FileContents:
    """The first picture of a TIFF file; row 0 is the first row along y.

    Unit of the heights: ImageJ's `vunit` with its linear calibration. Pixel size: OME, ImageJ, or a resolution per
    centimetre; one per inch is not believed. Raises HeightMapError, OSError.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path, _multifile=False) as file:  # OME may name other files, anywhere
            text = file.pages.first.description
            described = parsed_xml(text) if text.lstrip().startswith("<") else None
            if error := _size_error(file):
                raise HeightMapError(f"{path}: {error}")
            values, page = file.series[0].asarray(), file.pages.first
            if file.is_ome and described is not None:
                return FileContents(values, pixel=_ome_pixel(described))
            imagej = dict(file.imagej_metadata or {}) if file.is_imagej else {}
            unit = length_factor(str(imagej.get("unit"))) if imagej else None
            unit = M_PER_CM if not imagej and page.resolutionunit == _CENTIMETRE else unit
            per_unit = tuple(float(count) for count in page.resolution)
    except XmlError as error:
        raise HeightMapError(f"{path}: its description {error}") from error
    except (tifffile.TiffFileError, ValueError, IndexError) as error:
        raise HeightMapError(f"{path}: is no TIFF picture that can be read ({error})") from error
    pixel = None if unit is None or min(per_unit) <= 0.0 else (unit / per_unit[0], unit / per_unit[1])
    if {"vunit", "c0", "c1"} <= imagej.keys():
        values = float(imagej["c0"]) + float(imagej["c1"]) * np.asarray(values, np.float64)
    return FileContents(values, str(imagej["vunit"]) if "vunit" in imagej else None, pixel)


def _size_error(file: tifffile.TiffFile) -> str | None:
    """The reason why the picture cannot be in the file: a damaged header may declare more than memory holds."""
    picture, length = file.series[0], file.filehandle.size
    is_packed = file.pages.first.compression != 1  # TIFF 6.0, tag 259: no compression
    if picture.nbytes <= length * (_PACKED_AT_MOST if is_packed else 1):
        return memory_error(picture.nbytes)
    return f"is damaged: declares {' x '.join(map(str, picture.shape))} pixels of {picture.dtype} in {length} bytes"


def _ome_pixel(root: ElementTree.Element) -> _Pixel:
    pixels = next((node for node in root.iter() if node.tag.endswith("}Pixels")), None)
    stated = {} if pixels is None else pixels.attrib
    sizes: dict[str, float] = {}
    for axis in "XY":
        factor = length_factor(stated.get(f"PhysicalSize{axis}Unit", "um"))  # the schema's default is the micrometre
        if factor is not None and f"PhysicalSize{axis}" in stated:
            sizes[f"d{axis.lower()}"] = float(stated[f"PhysicalSize{axis}"]) * factor
    return pixel_of(sizes)
