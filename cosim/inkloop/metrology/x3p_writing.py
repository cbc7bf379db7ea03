"""Write height maps as X3P (ISO 25178-72): XML, binary heights and their checksums in a ZIP file."""

from __future__ import annotations

import hashlib
import zipfile
from datetime import UTC, datetime
from typing import BinaryIO
from xml.etree import ElementTree

import numpy as np

from inkloop import __version__
from inkloop.metrology.height_map import HeightMap

NAMESPACE = "http://www.opengps.eu/2008/ISO5436_2"
_XML, _HEIGHTS, _CHECKSUM = "main.xml", "bindata/data.bin", "md5checksum.hex"


def write_x3p(file: BinaryIO, map_: HeightMap) -> None:
    """A surface of 64-bit heights in metres, x fastest; NaN marks a point without a height."""
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
