"""Entries of slicers in 3MF that the standard does not know: parts that are no solid, items that are not printed."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from inkloop.errors import GeometryError
from inkloop.limits import parsed_xml

SOLID, CUT, NOTHING = range(3)
"""Roles of a triangle: of a part, of a volume that is taken away from its object, of what does not print."""
_ROLES = {
    **dict.fromkeys(("ModelPart", "normal_part"), SOLID),
    **dict.fromkeys(("NegativeVolume", "negative_part"), CUT),
    **dict.fromkeys(("ParameterModifier", "SupportEnforcer", "SupportBlocker"), NOTHING),
    **dict.fromkeys(("modifier_part", "support_enforcer", "support_blocker"), NOTHING),
}
"""By `volume_type` of PrusaSlicer, and `subtype` of Bambu Studio and OrcaSlicer."""
NO_PART = {"infill_mesh", "cutting_mesh", "anti_overhang_mesh", "support_mesh"}
"""Settings of an object that make it no part in Cura."""
_PRUSA, _BAMBU = "Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config"
_DRAINS = "Metadata/Slic3r_PE_sla_drain_holes.txt"
_PAINT = re.compile(rb'\b(?:mmu_segmentation|paint_color)="[^"]')
"""Attributes of painted triangles in files of PrusaSlicer, Bambu Studio and their relatives."""
_OBJECT_OR_PAINT = re.compile(rb'<(?:\w+:)?object\b[^>]*?\bid="(\d+)"|' + _PAINT.pattern)
_ITEM = re.compile(rb"<(?:\w+:)?item\b[^>]*>")
_NOT_PRINTED = re.compile(rb"""\bprintable\s*=\s*["'](?:0|false)["']""")


@dataclass(frozen=True)
class SlicerParts:
    """Entries of slicers in one file.

    ranges: object -> first and last triangle of each volume, and its kind; parts: (built object, part of it) -> kind;
    skipped: for each item of the build whether it is not printed; painted: (model part, object) with painted triangles.
    """

    source: Path

    ranges: dict[int, list[tuple[int, int, str]]]
    parts: dict[tuple[int, int], str]
    skipped: list[bool]
    painted: set[tuple[str, int]]

    @classmethod
    def of(cls, source: Path, archive: zipfile.ZipFile) -> SlicerParts:
        """Those of a package whose XML declares no entities. Raises GeometryError for what cannot be obeyed."""
        members = {member: archive.read(member) for member in (_PRUSA, _BAMBU, _DRAINS) if member in archive.namelist()}
        ranges = dict(_ranges(members[_PRUSA])) if _PRUSA in members else {}
        parts = dict(_parts(members[_BAMBU])) if _BAMBU in members else {}
        kinds = {*parts.values(), *(kind for volumes in ranges.values() for *_, kind in volumes)}
        errors = [
            f"has parts of the kind {kind!r}, which is not known; export it as STL"
            for kind in sorted(kinds - {*_ROLES})
        ]
        if b"object_id" in members.get(_DRAINS, b""):
            errors.append(f"has drain holes ({_DRAINS}), which are not read; export it as STL")
        if errors:
            raise GeometryError(f"{source}: {'; '.join(errors)}")
        painted = {found for name in archive.namelist() for found in _painted(name, archive.read(name))}
        skipped = [bool(_NOT_PRINTED.search(item)) for item in _ITEM.findall(_root(archive))]
        return cls(source, ranges, parts, skipped, painted)

    def volumes(self, built: int, part: int, count: int) -> list[tuple[str, int, slice]]:
        """Kind, role and triangles of the volumes of object `part`, which is all or part of object `built`.

        count: of its triangles. Raises GeometryError if the volumes do not hold them all.
        """
        ranges = self.ranges.get(part) or [(0, count - 1, self.parts.get((built, part), "ModelPart"))]
        if [first for first, *_ in ranges] + [count] != [0] + [last + 1 for _, last, _ in ranges]:
            raise GeometryError(
                f"{self.source}: the volumes of object {part} in {_PRUSA} do not hold its {count} triangles"
            )
        return [(kind, _ROLES[kind], slice(first, last + 1)) for first, last, kind in ranges]


def _ranges(config: bytes) -> Iterator[tuple[int, list[tuple[int, int, str]]]]:
    for entry in parsed_xml(config).iter("object"):
        volumes = []
        for volume in entry.iter("volume"):
            keys = {each.get("key", ""): each.get("value", "") for each in volume.iter("metadata")}
            kind = "ParameterModifier" if keys.get("modifier") == "1" else "ModelPart"  # of Slic3r
            ends = int(volume.attrib["firstid"]), int(volume.attrib["lastid"])
            volumes.append((*ends, keys.get("volume_type", kind)))
        yield int(entry.attrib["id"]), volumes


def _parts(config: bytes) -> Iterator[tuple[tuple[int, int], str]]:
    for entry in parsed_xml(config).iter("object"):
        for part in entry.iter("part"):
            yield (int(entry.attrib["id"]), int(part.attrib["id"])), part.get("subtype", "normal_part")


def _root(archive: zipfile.ZipFile) -> bytes:
    """The model part that the package names, whose build counts."""
    for relation in parsed_xml(archive.read("_rels/.rels")):
        if relation.get("Type", "").endswith("/3dmodel"):
            return archive.read(relation.attrib["Target"].lstrip("/"))
    return b""


def _painted(name: str, model: bytes) -> Iterator[tuple[str, int]]:
    """Part and number of the objects with triangles that a slicer has painted, which lib3mf leaves out."""
    number = 0
    for found in _OBJECT_OR_PAINT.finditer(model) if _PAINT.search(model) else ():
        if found[1]:
            number = int(found[1])
        else:
            yield f"/{name}", number
