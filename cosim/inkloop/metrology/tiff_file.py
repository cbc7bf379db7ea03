"""Height maps in TIFF files: floating-point heights or counts, with the tags that ImageJ, OME and scanners write."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import tifffile

from inkloop.errors import HeightMapError
from inkloop.limits import memory_error
from inkloop.metrology.file_contents import FileContents, length_factor
from inkloop.units import M_PER_CM

_CENTIMETRE = 3  # TIFF 6.0, tag 296; 2 is the inch, in which picture programs write 72 or 300 without meaning it
_PACKED_AT_MOST = 10_000  # bytes from one byte; deflate makes 1032, other methods some more of an even surface


def read_tiff(path: Path) -> FileContents:
    """The first picture of a TIFF file; row 0 is the first row along y.

    Unit of the heights: ImageJ's `vunit` with its linear calibration. Pixel size: OME, ImageJ, or a resolution per
    centimetre; one per inch is not believed. Raises HeightMapError, OSError.
    """
    try:
        with tifffile.TiffFile(path) as file:
            if error := _size_error(file):
                raise HeightMapError(f"{path}: {error}")
            values = file.series[0].asarray()
            if file.is_ome and file.ome_metadata:
                return FileContents(values, pixel=_ome_pixel(file.ome_metadata))
            imagej = dict(file.imagej_metadata or {}) if file.is_imagej else {}
            resolution = tuple(float(count) for count in file.pages.first.resolution)
            in_centimetres = file.pages.first.resolutionunit == _CENTIMETRE
    except (tifffile.TiffFileError, ValueError, IndexError) as error:
        raise HeightMapError(f"{path}: is no TIFF picture that can be read ({error})") from error
    if imagej:
        return FileContents(
            *_calibrated(values, imagej), pixel=_size(resolution, length_factor(str(imagej.get("unit"))))
        )
    return FileContents(values, pixel=_size(resolution, M_PER_CM if in_centimetres else None))


def _size_error(file: tifffile.TiffFile) -> str | None:
    """The reason why the picture cannot be in the file: a damaged header may declare more than memory holds."""
    picture, length = file.series[0], file.filehandle.size
    is_packed = file.pages.first.compression != tifffile.COMPRESSION.NONE
    if picture.nbytes <= length * (_PACKED_AT_MOST if is_packed else 1):
        return memory_error(picture.nbytes)
    return f"is damaged: declares {' x '.join(map(str, picture.shape))} pixels of {picture.dtype} in {length} bytes"


def _calibrated(values: Any, imagej: dict[str, Any]) -> tuple[Any, str | None]:
    """Heights and unit by ImageJ's linear calibration: value = c0 + c1 * stored, in `vunit`."""
    unit = str(imagej["vunit"]) if "vunit" in imagej else None
    if unit is None or not ("c0" in imagej and "c1" in imagej):
        return values, unit
    return float(imagej["c0"]) + float(imagej["c1"]) * np.asarray(values, np.float64), unit


def _size(resolution: tuple[float, ...], unit: float | None) -> tuple[float, float] | None:
    """Pixel size [m] from pixels per unit [m]."""
    if unit is None or min(resolution) <= 0.0:
        return None
    return unit / resolution[0], unit / resolution[1]


def _ome_pixel(text: str) -> tuple[float, float] | None:
    pixels = next((node for node in ElementTree.fromstring(text).iter() if node.tag.endswith("}Pixels")), None)
    if pixels is None:
        return None
    sizes = []
    for axis in "XY":
        factor = length_factor(pixels.get(f"PhysicalSize{axis}Unit", "um"))  # the schema's default is the micrometre
        size = pixels.get(f"PhysicalSize{axis}")
        if size is None or factor is None:
            return None
        sizes.append(float(size) * factor)
    return sizes[0], sizes[1]
