"""3MF packages written by hand, so that a test decides every byte."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

from support.meshes import Triangles

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
_RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="rel0" '
    'Target="/3D/3dmodel.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


def mesh_object(number: int, triangles: Triangles, name: str = "", material: int | None = None) -> str:
    """An object with a mesh; material: index of a base material of group 1."""
    corners = triangles.reshape(-1, 3).tolist()
    vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in corners)
    faces = "".join(f'<triangle v1="{n}" v2="{n + 1}" v3="{n + 2}"/>' for n in range(0, len(corners), 3))
    attributes = f'name="{name}"' if name else ""
    attributes += f' pid="1" pindex="{material}"' if material is not None else ""
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh>"
    return f'<object id="{number}" type="model" {attributes}>{mesh}</object>'


def model_xml(objects: str, items: str, unit: str = "millimeter", attributes: str = "", materials: str = "") -> str:
    """The model part. materials: names of base materials, separated by blanks; they are group 1."""
    bases = "".join(f'<base name="{name}" displaycolor="#FF0000"/>' for name in materials.split())
    group = f'<basematerials id="1">{bases}</basematerials>' if bases else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><model unit="{unit}" xml:lang="en-US" xmlns="{CORE}" {attributes}>'
        f"<resources>{group}{objects}</resources><build>{items}</build></model>"
    )


def package(model: str | bytes, others: Mapping[str, bytes] | None = None) -> bytes:
    """The file."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", _TYPES)
        archive.writestr("_rels/.rels", _RELATIONS)
        archive.writestr("3D/3dmodel.model", model)
        for name, data in (others or {}).items():
            archive.writestr(name, data)
    return file.getvalue()
