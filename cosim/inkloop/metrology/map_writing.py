"""Write height maps for metrology tools; `read` gives the same map back."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree

import numpy as np

from inkloop import __version__
from inkloop.errors import require
from inkloop.files import replaced
from inkloop.metrology.height_map import HeightMap
from inkloop.units import M_PER_CM, UM_PER_M

NAMESPACE = "http://www.opengps.eu/2008/ISO5436_2"
_XML, _HEIGHTS, _CHECKSUM = "main.xml", "bindata/data.bin", "md5checksum.hex"


def write(path: Path, map_: HeightMap, form: str) -> None:
    """Write a map whole or not at all; a pixel without a height is NaN in every format. Raises OSError,
    InkloopError where the library of a format is missing.

    form: "npy" (float64 in m, first index along x), "tiff" (float32 in um), "sdf" and "x3p" (float64 in m); in the last
    three a row lies along x and the first one is y = 0.
    """
    with replaced(path) as partial, partial.open("wb") as file:
        _WRITERS[form](file, map_)


def _npy(file: BinaryIO, map_: HeightMap) -> None:
    """The array alone: neither unit nor size of a pixel."""
    np.save(file, map_.z)


def _tiff(file: BinaryIO, map_: HeightMap) -> None:
    """With pixels per centimetre, and ImageJ's description, which has a unit for the heights."""
    require("tifffile", "a TIFF file").imwrite(
        file,
        (map_.z.T * UM_PER_M).astype(np.float32),
        imagej=True,
        resolution=(M_PER_CM / map_.dx, M_PER_CM / map_.dy),
        resolutionunit="CENTIMETER",
        metadata={"unit": "cm", "vunit": "um"},
    )


def _sdf(file: BinaryIO, map_: HeightMap) -> None:
    """ISO 25178-71, binary."""
    sdfio = require("sdfio", "an SDF file")
    metadata = sdfio.Metadata(manufacturer_id="inkloop")
    sdfio.write(file, map_.z.T, x_scale=map_.dx, y_scale=map_.dy, z_scale=1.0, metadata=metadata)


def _x3p(file: BinaryIO, map_: HeightMap) -> None:
    """ISO 25178-72: XML, 64-bit heights in metres with x fastest, and their checksums in a ZIP file."""
    heights = np.ascontiguousarray(map_.z.T, "<f8").tobytes()
    xml = ElementTree.tostring(_document(map_, _md5(heights)), encoding="utf-8", xml_declaration=True)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(_XML, xml)
        archive.writestr(_HEIGHTS, heights)
        archive.writestr(_CHECKSUM, f"{_md5(xml)} *{_XML}\n")


def _document(map_: HeightMap, checksum: str) -> ElementTree.Element:
    """The four records of the document, elements in the order of its schema."""
    ElementTree.register_namespace("p", NAMESPACE)
    root = ElementTree.Element(f"{{{NAMESPACE}}}ISO5436_2")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    nx, ny = map_.shape

    record = ElementTree.SubElement(root, "Record1")
    _text(record, Revision="ISO5436 - 2000", FeatureType="SUR")
    axes = ElementTree.SubElement(record, "Axes")
    for axis, step, offset in (("CX", map_.dx, map_.x0), ("CY", map_.dy, map_.y0)):
        _text(ElementTree.SubElement(axes, axis), AxisType="I", DataType="D", Increment=step, Offset=offset)
    _text(ElementTree.SubElement(axes, "CZ"), AxisType="A", DataType="D")

    record = ElementTree.SubElement(root, "Record2")
    _text(record, Date=now, Creator="inkloop")
    device = {"Manufacturer": "inkloop", "Model": "inkloop", "Serial": "none", "Version": __version__}
    _text(ElementTree.SubElement(record, "Instrument"), **device)
    _text(record, CalibrationDate=now)
    _text(ElementTree.SubElement(record, "ProbingSystem"), Type="Software", Identification="inkloop")
    _text(record, Comment=map_.source)

    record = ElementTree.SubElement(root, "Record3")
    _text(ElementTree.SubElement(record, "MatrixDimension"), SizeX=nx, SizeY=ny, SizeZ=1)
    _text(ElementTree.SubElement(record, "DataLink"), PointDataLink=_HEIGHTS, MD5ChecksumPointData=checksum)

    _text(ElementTree.SubElement(root, "Record4"), ChecksumFile=_CHECKSUM)
    return root


def _text(parent: ElementTree.Element, **elements: object) -> None:
    for name, value in elements.items():
        ElementTree.SubElement(parent, name).text = str(value)


def _md5(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest().upper()


_WRITERS: Mapping[str, Callable[[BinaryIO, HeightMap], None]] = {"npy": _npy, "tiff": _tiff, "sdf": _sdf, "x3p": _x3p}
