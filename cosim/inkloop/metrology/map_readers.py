"""Contents of height map files before the caller's options complete them: NumPy, TIFF, SDF, formats of instruments."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias
from zipfile import BadZipFile, ZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import HeightMapError
from inkloop.limits import XmlError, check_xml, memory_error, parsed_xml
from inkloop.units import M_PER_CM, M_PER_PM, SUFFIXES

if TYPE_CHECKING:
    from xml.etree import ElementTree

    import tifffile

_METRES = {**SUFFIXES["m"], "pm": M_PER_PM, "cm": M_PER_CM}
_SPELLINGS = {"\u00b5m": "um", "\u03bcm": "um", "micron": "um", "microns": "um"}  # micro sign, Greek mu
_HEIGHTS = ("z", "height")
_CENTIMETRE = 3  # TIFF 6.0, tag 296; 2 is the inch, in which picture programs write 72 or 300 without meaning it
_NODATA = 42113  # the tag of GDAL
_BYTE = 8  # bits; colour maps of TIFF have 16
PIXEL_TOLERANCE = 0.01  # files round the size of their pixels (assumed)
_SHOWN = 100  # characters of an error of a library, which may show what it could not unpack
_PACKED_AT_MOST = 10_000  # bytes from one byte; deflate makes 1032, other methods some more of an even surface
Pixel: TypeAlias = tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class FileContents:
    """Values as stored, with the statements of the file about them, None where it has none.

    values: numbers in `unit`, NaN where nothing was measured, 2-D, or of a profile 1-D; pixel: (dx, dy) [m];
    rows_along: the coordinate that a stored row lies along: "x" where the first index goes along y, as in pictures and
    tables, "y" where it goes along x, as inkloop's own arrays do; invalid: the stored number of a pixel without a
    height; channel: which of several was read, for a person.
    """

    values: NDArray[Any]
    unit: str | None = None
    pixel: Pixel = None
    rows_along: Literal["x", "y"] = "x"
    invalid: float | None = None
    channel: str = ""


def length_factor(unit: str) -> float | None:
    """Metres in a unit of length as files spell it, None if it is none."""
    plain = re.sub(r"\\u([0-9A-Fa-f]{4})", lambda code: chr(int(code[1], 16)), unit.strip())  # ImageJ escapes so
    return _METRES.get(_SPELLINGS.get(plain, plain))


def chosen(path: Path, names: Sequence[str], channel: str | None) -> int | None:
    """Index of a channel, given by its name or by its number from 1; None where none is given.

    Raises HeightMapError with the names.
    """
    if channel is None:
        return None
    if names.count(channel) == 1:
        return names.index(channel)
    if channel.isdecimal() and 0 < int(channel) <= len(names):
        return int(channel) - 1
    known = ", ".join(f"{number} {name!r}" for number, name in enumerate(names, start=1))
    raise HeightMapError(f"{path}: channel (--channel) is {channel!r}; expected one of {known}")


def pixel_of(sizes: Mapping[str, float]) -> Pixel:
    """dx and dy of the sizes "dx", "dy" and "both" [m], None where one of the two is unknown."""
    dx, dy = (sizes.get(name, sizes.get("both")) for name in ("dx", "dy"))
    return None if dx is None or dy is None else (dx, dy)


def read_array(path: Path, channel: str | None = None) -> FileContents:
    """An NPY file, or an NPZ file with `z_um` or `height_m` ... and `pixel_um`, or `dx_um` and `dy_um`.

    In an NPZ the unit stands in the key; a key without one (`z`, or the only 2-D array) leaves it to the caller.
    channel: the key. Raises HeightMapError, OSError.
    """
    try:
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            if isinstance(loaded, np.ndarray) and file.read(1):
                raise ValueError("it holds more bytes than its header states")
            arrays = {} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except (ValueError, EOFError, BadZipFile) as error:
        raise HeightMapError(f"{path}: is no array of numbers that NumPy saved ({str(error)[:_SHOWN]})") from error
    if isinstance(loaded, np.ndarray):
        chosen(path, ["the array"], channel)
        return FileContents(loaded, rows_along="y")
    key, unit = _heights(path, arrays, channel)
    sizes = {
        name: float(arrays[f"{key}_{suffix}"]) * factor
        for name, key in (("both", "pixel"), ("dx", "dx"), ("dy", "dy"))
        for suffix, factor in SUFFIXES["m"].items()
        if f"{key}_{suffix}" in arrays and arrays[f"{key}_{suffix}"].size == 1
    }
    return FileContents(arrays[key], unit, pixel_of(sizes), rows_along="y")


def _heights(path: Path, arrays: dict[str, np.ndarray], channel: str | None) -> tuple[str, str | None]:
    """Key of the heights and the unit in its name."""
    names = [name for name, array in arrays.items() if array.ndim]
    if (index := chosen(path, names, channel)) is not None:
        key = names[index]
        return key, next((suffix for suffix in SUFFIXES["m"] if key.endswith(f"_{suffix}")), None)
    keys = {f"{name}_{suffix}": suffix for name in _HEIGHTS for suffix in SUFFIXES["m"]} | dict.fromkeys(_HEIGHTS)
    named = [(key, unit) for key, unit in keys.items() if key in arrays]
    found = named or [(name, None) for name, array in arrays.items() if array.ndim == 2]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "nothing"
    raise HeightMapError(
        f"{path}: holds {listed}; expected one map, named z_um, height_um or z, or name it in channel (--channel)"
    )


def read_sdf(path: Path) -> FileContents:
    """A surface of ISO 25178-71, as text or binary. Raises HeightMapError, OSError."""
    import sdfio

    try:
        surface = sdfio.read(path)
    except (sdfio.SdfError, ValueError) as error:
        raise HeightMapError(f"{path}: is no SDF file as ISO 25178-71 has it ({error})") from error
    pixel = float(surface.header.x_scale), float(surface.header.y_scale)
    return FileContents(np.asarray(surface.data, np.float64), "m", pixel)


def read_instrument(path: Path, channel: str | None = None) -> FileContents:
    """A channel, by default the library's, of a file of an instrument: SUR, X3P, GWY, VK, OPD ...

    Raises HeightMapError, OSError.
    """
    from SurfaceTopography import open_topography

    try:
        if is_zipfile(path):
            with ZipFile(path) as archive:
                if "main.xml" in archive.namelist():  # X3P
                    with archive.open("main.xml") as file:
                        check_xml(file)
        reader = open_topography(str(path))
        names = [str(each.name) for each in reader.channels]
        index = chosen(path, names, channel)
        name = reader.default_channel.name if index is None else names[index]
        topography = reader.topography(channel_index=index)
        heights = np.ma.filled(topography.heights().astype(np.float64), np.nan)
        unit, sizes = topography.unit, topography.physical_sizes
    except HeightMapError:
        raise
    except Exception as error:  # each of its readers fails in its own way, on bytes of unknown origin
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise HeightMapError(f"{path}: SurfaceTopography cannot read it ({reason})") from error
    words = f"channel {name} of {', '.join(names)}" if len(names) > 1 else f"channel {name}"
    if heights.ndim == 1 and not topography.is_uniform:
        raise HeightMapError(f"{path}: holds a profile with uneven steps; save it with even ones")
    factor = None if unit is None else length_factor(str(unit))
    pixel = None
    if factor is not None and sizes is not None:
        steps = [float(size) * factor / count for size, count in zip(sizes, heights.shape, strict=True)]
        pixel = steps[0], steps[-1]
    return FileContents(heights, unit, pixel, rows_along="y", channel=words)


def read_tiff(path: Path, channel: str | None = None) -> FileContents:
    """A page of a TIFF file, by default the only or first one; row 0 is the first row along y.

    Unit of the heights: ImageJ's `vunit` with its linear calibration. Pixel size: OME, ImageJ, or a resolution per
    centimetre; one per inch is not believed. No data: GDAL's tag. channel: the number of the page. Raises
    HeightMapError, OSError.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path, _multifile=False) as file:  # OME may name other files, anywhere
            text = file.pages.first.description
            is_xml = file.is_ome or "<!DOCTYPE" in text  # which a parser of the library follows
            described = parsed_xml(text) if is_xml else None
            values, page, words = _page(path, file, channel)
            tag = page.tags.get(_NODATA)
            invalid = None if tag is None else float(tag.value)
            if file.is_ome and described is not None:
                return FileContents(values, pixel=_ome_pixel(described), invalid=invalid, channel=words)
            imagej = dict(file.imagej_metadata or {}) if file.is_imagej else {}
            unit = length_factor(str(imagej.get("unit"))) if imagej else None
            unit = M_PER_CM if not imagej and page.resolutionunit == _CENTIMETRE else unit
            per_unit = tuple(float(count) for count in page.resolution)
    except XmlError as error:
        raise HeightMapError(f"{path}: its description {error}") from error
    except (tifffile.TiffFileError, ValueError, IndexError) as error:
        raise HeightMapError(f"{path}: is no TIFF picture that can be read ({str(error)[:_SHOWN]})") from error
    pixel = None if unit is None or min(per_unit) <= 0.0 else (unit / per_unit[0], unit / per_unit[1])
    if {"vunit", "c0", "c1"} <= imagej.keys():
        values = float(imagej["c0"]) + float(imagej["c1"]) * np.asarray(values, np.float64)
    height_unit = str(imagej["vunit"]) if "vunit" in imagej else None
    return FileContents(values, height_unit, pixel, invalid=invalid, channel=words)


def _page(path: Path, file: tifffile.TiffFile, channel: str | None) -> tuple[NDArray[Any], tifffile.TiffPage, str]:
    """The values of a page, the page that describes it, and which it is. Raises HeightMapError."""
    counts = [prod(series.shape[:-2]) if series.axes.endswith("YX") else 1 for series in file.series]
    pages = [(series, k) for series, count in zip(file.series, counts, strict=True) for k in range(count)]
    index = chosen(path, [str(number) for number in range(1, len(pages) + 1)], channel)
    if index is None and counts[0] > 1:
        raise HeightMapError(f"{path}: holds {len(pages)} pages; give channel (--channel), the number of one of them")
    series, k = pages[index or 0]
    page = series.keyframe
    if error := _size_error(file, series):
        raise HeightMapError(f"{path}: {error}")
    values = series.asarray()
    if series.axes.endswith("YX"):
        values = values.reshape(-1, *values.shape[-2:])[k]
    palette = page.colormap
    if palette is not None and not file.is_imagej:  # in ImageJ a palette only shows values
        red, green, blue = palette[:, values]
        if not (np.array_equal(red, green) and np.array_equal(red, blue)):
            raise HeightMapError(f"{path}: has colours (palette); expected grey values: save it as greyscale")
        values = (red >> (_BYTE if palette.max() >> _BYTE else 0)).astype(np.uint8)
    return values, page, f"page {(index or 0) + 1} of {len(pages)}" if len(pages) > 1 else ""


def _size_error(file: tifffile.TiffFile, series: tifffile.TiffPageSeries) -> str | None:
    """The reason why pictures cannot be in the file: a damaged header may declare more than memory holds."""
    length = file.filehandle.size
    is_packed = series.keyframe.compression != 1  # TIFF 6.0, tag 259: no compression
    if series.nbytes <= length * (_PACKED_AT_MOST if is_packed else 1):
        return memory_error(series.nbytes)
    return f"is damaged: declares {' x '.join(map(str, series.shape))} pixels of {series.dtype} in {length} bytes"


def _ome_pixel(root: ElementTree.Element) -> Pixel:
    pixels = next((node for node in root.iter() if node.tag.endswith("}Pixels")), None)
    stated = {} if pixels is None else pixels.attrib
    sizes: dict[str, float] = {}
    for axis in "XY":
        factor = length_factor(stated.get(f"PhysicalSize{axis}Unit", "um"))  # the schema's default is the micrometre
        if factor is not None and f"PhysicalSize{axis}" in stated:
            sizes[f"d{axis.lower()}"] = float(stated[f"PhysicalSize{axis}"]) * factor
    return pixel_of(sizes)
