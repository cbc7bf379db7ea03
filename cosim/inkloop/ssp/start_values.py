"""An FMU of FMI 2 that begins with the parameters of a system, for tools that cannot set them by the hundred."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

from inkloop.files import replaced
from inkloop.ssp.system import Part

_DESCRIPTION = "modelDescription.xml"


def write(part: Part, out: Path) -> None:
    """Write the part's FMU with its values as start values; everything else in it stays as it is."""
    values = {
        element: str(number).lower()
        for name, value in part.values.items()
        for element, number in zip(part.scalars(name), value.ravel().tolist(), strict=True)
    }
    with replaced(out) as partial, zipfile.ZipFile(part.file) as read, zipfile.ZipFile(partial, "w") as archive:
        for member in read.infolist():
            content = read.read(member)
            archive.writestr(member, _begun(content, values) if member.filename == _DESCRIPTION else content)


def _begun(description: bytes, values: dict[str, str]) -> bytes:
    root = ET.fromstring(description)
    for variable in root.iterfind("ModelVariables/ScalarVariable"):
        if variable.get("name") in values:
            variable[0].set("start", values[variable.get("name", "")])
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text
