"""An FMU of FMI 2 that begins with the parameters of a system, for tools that cannot set them by the hundred."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

from inkloop.exchange.ssp.system import Part
from inkloop.files import replaced

_DESCRIPTION = "modelDescription.xml"


def write(part: Part, out: Path, *, enumerations: bool = True) -> None:
    """Write the part's FMU with its values as start values; everything else in it stays as it is.

    enumerations: False declares them as integers, which FMI 2 sets by the same calls, for tools that know none.
    """
    values = {
        element: str(number).lower()
        for name, value in part.values.items()
        for element, number in zip(part.scalars(name), value.ravel().tolist(), strict=True)
    }
    with replaced(out) as partial, zipfile.ZipFile(part.file) as read, zipfile.ZipFile(partial, "w") as archive:
        for member in read.infolist():
            content = read.read(member)
            if member.filename == _DESCRIPTION:
                content = _begun(content, values, enumerations)
            archive.writestr(member, content)


def _begun(description: bytes, values: dict[str, str], enumerations: bool) -> bytes:
    root = ET.fromstring(description)
    for variable in root.iterfind("ModelVariables/ScalarVariable"):
        if variable.get("name") in values:
            variable[0].set("start", values[variable.get("name", "")])
        if not enumerations and variable[0].tag == "Enumeration":
            variable[0].tag = "Integer"
            variable[0].attrib.pop("declaredType")  # a type of enumerations
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text
