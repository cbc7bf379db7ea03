"""3MF: the objects of its build, each with its name and its material, read by lib3mf."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import lib3mf
import numpy as np
from numpy.typing import NDArray

from inkloop.errors import GeometryError
from inkloop.geometry.body import Body, transformed
from inkloop.geometry.slicer_parts import CUT, NO_PART, NOTHING, SOLID, SlicerParts
from inkloop.limits import XmlError, check_xml, memory_error

_BYTES_PER_TRIANGLE = 3 * 72
"""Three corners of three numbers, and two copies of them while they are placed."""
_UNITS = ("um", "mm", "cm", "in", "ft", "m")
"""In the order of lib3mf's ModelUnit."""
_EXTENSIONS = {
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/production/2015/06",
}
"""Namespaces that a file may require; lib3mf reads them. Levelsets, slices and others are the geometry itself."""
_COPIES_MAX = 1_000_000
"""Of meshes in one assembly (assumed): lib3mf takes 10 ns for each."""
_SHAPELESS = {
    *(0x805C, 0x805D, 0x80AE, 0x80B2, 0x80C6),  # metadata
    *(0x809C, 0x80A0, 0x80AD, 0x80B0),  # UUIDs
    *(0x80B6, 0x80B7, 0x80B8),  # thumbnails
}
"""Warnings of lib3mf that touch no shape."""
_OBEYED = {0x80A7, 0x80BD}
"""Warnings of attributes that the standard does not know, of slicers above all, and of objects of type other."""
_TYPES = ("other", "model", "support", "solidsupport", "surface")
"""In the order of lib3mf's ObjectType."""


def read_3mf(path: Path) -> tuple[list[Body], str]:
    """The bodies of the build, in the unit of the file, and that unit. Raises GeometryError, and errors of lib3mf."""
    if errors := list(_package_errors(path)):
        raise GeometryError(f"{path}: " + "; ".join(errors))
    with zipfile.ZipFile(path) as archive:
        slicer = SlicerParts.of(path, archive)
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(False)  # slicers write attributes of their own
    try:
        reader.ReadFromFile(str(path))
    except lib3mf.ELib3MFException as error:
        reason = str(error).rpartition(": ")[2]  # without the place, which lib3mf does not know
        raise GeometryError(f"{path}: lib3mf refuses it: {reason}; save it again") from error
    warnings = dict(reader.GetWarning(n) for n in range(reader.GetWarningCount()))
    if texts := sorted({text for code, text in warnings.items() if code not in _OBEYED | _SHAPELESS}):
        raise GeometryError(f"{path}: holds what lib3mf would leave out: {' '.join(texts)} Save it as plain 3MF")
    found = _Model(path, model, slicer)
    bodies = list(found.bodies())
    remarks = [f"not printed: {', '.join(found.left_out)}"] if found.left_out else []
    if not bodies:
        raise GeometryError(f"{path}: {'; '.join(remarks)}; nothing is left, save it with the objects to be printed")
    remarks += [f"lib3mf: {text}: touches no shape" for code, text in sorted(warnings.items()) if code in _SHAPELESS]
    bodies[0] = replace(bodies[0], remarks=(*remarks, *bodies[0].remarks))
    return bodies, _UNITS[int(model.GetUnit())]


def _package_errors(path: Path) -> Iterator[str]:
    """Reasons to reject a package: document types, extensions that would be ignored, endless copies."""
    assemblies = []
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            data = archive.read(member)
            if b"<" not in data.lstrip()[:4]:  # a picture; names of parts decide nothing
                continue
            if b"\0" in data[:4]:
                yield f"{member.filename} is UTF-16; save it in UTF-8"
                return
            try:
                check_xml(io.BytesIO(data))
            except XmlError as error:
                yield f"{member.filename} {error}"
                return
            for name, namespace in _required(data).items():
                if namespace not in _EXTENSIONS:
                    yield f"{member.filename} requires the extension {name} ({namespace}), which is not read"
            if b"component" in data:
                assemblies.append(data)
    if (copies := _copies(assemblies)) > _COPIES_MAX:
        yield f"its components are {copies:.3g} copies of its meshes; at most {_COPIES_MAX:,} are taken"


def _copies(parts: list[bytes]) -> int:
    """Meshes that the largest object consists of, copies included; lib3mf would visit each of them."""
    meshes: dict[str, int] = {}
    current = ""

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal current
        kind = name.rpartition(":")[2]
        if kind == "object":
            current = attributes.get("id", "")
            meshes[current] = 0
        elif kind == "component":
            meshes[current] = meshes.get(current, 0) + max(1, meshes.get(attributes.get("objectid", ""), 1))

    for data in (*parts, *parts):  # twice: the objects of a part may be used in one before it
        parser = expat.ParserCreate()
        parser.StartElementHandler = start
        parser.Parse(data, True)
    return max(meshes.values(), default=0)


def _required(data: bytes) -> dict[str, str]:
    """Prefix and namespace of the extensions that a model part requires; the prefix itself where it has none."""
    namespaces: dict[str, str] = {}
    for event, value in ElementTree.iterparse(io.BytesIO(data), events=("start-ns", "start")):
        if event == "start":
            required: list[str] = value.attrib.get("requiredextensions", "").split()
            return {prefix: namespaces.get(prefix, prefix) for prefix in required}
        prefix, namespace = value
        namespaces[prefix] = namespace
    return {}


class _Model:
    """A model of lib3mf; `Any` is its objects, which have no types. left_out: what is not printed, and why."""

    def __init__(self, path: Path, model: Any, slicer: SlicerParts) -> None:
        self._path, self._model, self._slicer = path, model, slicer
        self._counts: dict[int, int] = {}
        self._own: dict[tuple[int, int], Body] = {}
        self.left_out: list[str] = []

    def bodies(self) -> Iterator[Body]:
        """One for each mesh of each item that is to be built."""
        items = list(_iterated(self._model.GetBuildItems()))
        if not items:
            raise GeometryError(f"{self._path}: its build lists no object; save it with the objects to be printed")
        count = sum(self._count(item.GetObjectResource()) for item in items)
        if reason := memory_error(_BYTES_PER_TRIANGLE * count):
            raise GeometryError(f"{self._path}: has {count:,} triangles in all copies of its objects: {reason}")
        for item, is_skipped in zip(items, self._slicer.skipped, strict=True):
            entry = item.GetObjectResource()
            if is_skipped:
                self._leave_out(entry, 'printable="0"')
                continue
            built = entry.GetModelResourceID()
            found = list(self._placed(entry, *_placement(item.GetObjectTransform()), "", built))
            cut = np.concatenate([np.empty((0, 3, 3)), *(body.cut for body in found)])
            remarks = (f"a negative volume is taken away from {_called(entry)}",) if len(cut) else ()
            yield from (replace(body, cut=cut, remarks=remarks) for body in found if len(body.triangles))

    def _leave_out(self, entry: Any, why: str) -> None:
        self.left_out.append(f"{_called(entry)} ({why})")

    def _count(self, entry: Any) -> int:
        """Triangles of an object with all that it consists of; an object is counted once, whatever refers to it."""
        key = entry.GetUniqueResourceID()
        if key not in self._counts:
            if entry.IsMeshObject():
                self._counts[key] = entry.GetTriangleCount()
            elif entry.IsComponentsObject():
                self._counts[key] = sum(self._count(part.GetObjectResource()) for part in _parts(entry))
            else:
                raise GeometryError(
                    f"{self._path}: {_called(entry)} is a level set, which is not read; save it as a mesh"
                )
        return self._counts[key]

    def _placed(self, entry: Any, matrix: NDArray[Any], shift: NDArray[Any], name: str, built: int) -> Iterator[Body]:
        if why := _no_part(entry):
            self._leave_out(entry, why)
            return
        name = entry.GetName() or name
        if entry.IsMeshObject():
            own = self._body(entry, built)
            yield transformed(replace(own, name=name), matrix, shift)
            return
        for part in _parts(entry):
            inner, offset = _placement(part.GetTransform())
            yield from self._placed(part.GetObjectResource(), matrix @ inner, matrix @ offset + shift, name, built)

    def _body(self, entry: Any, built: int) -> Body:
        """Triangles of its solid volumes and of its negative ones; built: number of the object that it belongs to."""
        key = entry.GetUniqueResourceID(), built
        if key not in self._own:
            vertices = np.frombuffer(b"".join(entry.GetVertices()), dtype=np.float32).reshape(-1, 3)
            indices = np.frombuffer(b"".join(entry.GetTriangleIndices()), dtype=np.uint32).reshape(-1, 3)
            roles = np.empty(len(indices), np.int8)
            for kind, role, triangles in self._slicer.volumes(built, entry.GetModelResourceID(), len(indices)):
                roles[triangles] = role
                if role == NOTHING:
                    self._leave_out(entry, kind)
            names = self._materials(entry, roles == SOLID)
            material, paint = (names[0], ()) if len(names) == 1 else ("", tuple(names))
            solid, cut = (vertices[indices[roles == role]].astype(np.float64) for role in (SOLID, CUT))
            self._own[key] = Body(solid, "", material, paint, cut=cut)
        return self._own[key]

    def _materials(self, mesh: Any, which: NDArray[np.bool_]) -> list[str]:
        """Names of the materials of some triangles; materials other than base materials are numbered."""
        rows = np.frombuffer(b"".join(mesh.GetAllTriangleProperties()), dtype=np.uint32).reshape(-1, 4)[which]
        pairs = np.unique(np.stack([rows[:, [0, 0, 0]], rows[:, 1:]], axis=-1).reshape(-1, 2), axis=0).tolist()
        groups = {one.GetUniqueResourceID(): one for one in _iterated(self._model.GetBaseMaterialGroups())}
        names = ["" if group == 0 else f"colour {entry} of group {group}" for group, entry in pairs]
        for number, (group, entry) in enumerate(pairs):
            if group in groups:
                names[number] = str(groups[group].GetName(entry))
        is_painted = (mesh.PackagePart().GetPath(), mesh.GetModelResourceID()) in self._slicer.painted
        return [*names, "colours of a slicer"] if is_painted else names


def _called(entry: Any) -> str:
    return f"object {entry.GetName() or f'number {entry.GetModelResourceID()}'}"


def _no_part(entry: Any) -> str:
    """The reason why an object is no part; "" for a part."""
    if (kind := _TYPES[int(entry.GetType())]) != "model":
        return f"type {kind}"
    group = entry.GetMetaDataGroup()
    for data in (group.GetMetaData(n) for n in range(group.GetMetaDataCount())):
        if (name := data.GetName().rpartition(":")[2]) in NO_PART and data.GetValue().lower() in ("true", "1"):
            return str(name)
    return ""


def _parts(entry: Any) -> Iterator[Any]:
    return (entry.GetComponent(n) for n in range(entry.GetComponentCount()))


def _iterated(iterator: Any) -> Iterator[Any]:
    while iterator.MoveNext():
        yield iterator.GetCurrent()


def _placement(transform: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Matrix and shift of a transform, which 3MF writes for rows of coordinates."""
    fields = np.array([list(row) for row in transform.Fields], dtype=np.float64)
    return fields[:3].T, fields[3]
