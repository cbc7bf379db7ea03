"""3MF: only parts print, negative volumes are taken away, and what changes no shape is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from inkloop.errors import GeometryError
from inkloop.geometry import cell_centers, load, load_inks
from inkloop.geometry.mesh_file import read_bodies
from inkloop.report.part_report import MeshReport
from inkloop.scenario.part_file import PartFile, mesh_of_file
from inkloop.scenario.part_grid import fit
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.shapes import Grid
from support import meshes
from support.three_mf import mesh_object, model_xml, package

pytest.importorskip("lib3mf")

LOW = meshes.box((0, 0, 0), (3, 2, 1))
TAKEN = meshes.box((0.5, -1, 0.25), (1.5, 3, 2))
"""1.5 mm3 of LOW."""
PRUSA = "Metadata/Slic3r_PE_model.config"
BAMBU = "Metadata/model_settings.config"
PAIR = '<object id="4" type="model" name="pair"><components><component objectid="2"/>{}</components></object>'
OTHER = '<component objectid="3"/>'


def written(folder: Path, model: str, others: dict[str, bytes] | None = None) -> Path:
    path = folder / "part.3mf"
    path.write_bytes(package(model, others))
    return path


def slic3r(kind: str, key: str = "volume_type", last: int = 23) -> dict[str, bytes]:
    """Two volumes of object 2, of 12 triangles each; the second is of a kind."""
    keys = f'<metadata type="volume" key="{key}" value="{kind}"/>'
    volumes = f'<volume firstid="0" lastid="11"/><volume firstid="12" lastid="{last}">{keys}</volume>'
    return {PRUSA: f'<config><object id="2">{volumes}</object></config>'.encode()}


def bambu(kind: str) -> dict[str, bytes]:
    """Object 4 of two parts, of which object 3 is of a kind."""
    parts = f'<part id="2" subtype="normal_part"/><part id="3" subtype="{kind}"/>'
    return {BAMBU: f'<config><object id="4">{parts}</object></config>'.encode()}


ONE_MESH = mesh_object(2, np.concatenate([LOW, TAKEN]), "part"), '<item objectid="2"/>'
TWO_PARTS = mesh_object(2, LOW) + mesh_object(3, TAKEN) + PAIR.format(OTHER), '<item objectid="4"/>'
TWO_ITEMS = mesh_object(2, LOW) + mesh_object(3, TAKEN, "extra"), '<item objectid="2"/><item objectid="3"{}/>'
METADATA = '<metadatagroup><metadata name="cura:{}" type="xs:boolean">{}</metadata></metadatagroup>'
PATH = "/3D/Objects/object_1.model"
ELSEWHERE = (
    f'<object id="4" type="model" name="pair"><components><component objectid="2" p:path="{PATH}"/>'
    f'<component objectid="3" p:path="{PATH}"/></components></object>',
    '<item objectid="4"/>',
)
"""Its meshes lie in another model part."""
RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="r" '
    f'Target="{PATH}" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
).encode()
SUB_MODEL = {
    PATH[1:]: model_xml(mesh_object(2, LOW) + mesh_object(3, TAKEN), "").encode(),
    "3D/_rels/3dmodel.model.rels": RELATIONS,
}


def cura(setting: str, value: str = "True") -> tuple[str, str]:
    objects, items = TWO_ITEMS
    head, tail = objects.rsplit("<mesh>", 1)
    return head + METADATA.format(setting, value) + "<mesh>" + tail, items.format("")


def of_type(kind: str) -> tuple[str, str]:
    objects, items = TWO_ITEMS
    return objects.replace('id="3" type="model"', f'id="3" type="{kind}"'), items.format("")


CUT, WHOLE = 4.5, 6.0
ROLES: dict[str, tuple[tuple[str, str], dict[str, bytes], float, str]] = {
    **{f"type {kind}": (of_type(kind), {}, WHOLE, f"object extra (type {kind})")
       for kind in ("support", "solidsupport", "surface", "other")},
    "component of type support": (
        (of_type("support")[0] + PAIR.format(OTHER), TWO_PARTS[1]), {}, WHOLE, "object extra (type support)",
    ),
    "printable false": (
        (TWO_ITEMS[0], TWO_ITEMS[1].format(' printable="false"')), {}, WHOLE, 'object extra (printable="0")',
    ),
    "printable 0": ((TWO_ITEMS[0], TWO_ITEMS[1].format(' printable="0"')), {}, WHOLE, 'object extra (printable="0")'),
    "slic3r": (ONE_MESH, slic3r("1", "modifier"), WHOLE, "object part (ParameterModifier)"),
    **{f"prusa {kind}": (ONE_MESH, slic3r(kind), WHOLE, f"not printed: object part ({kind})")
       for kind in ("ParameterModifier", "SupportEnforcer", "SupportBlocker")},
    "prusa negative": (ONE_MESH, slic3r("NegativeVolume"), CUT, "negative volume is taken away from object part"),
    **{f"bambu {kind}": (TWO_PARTS, bambu(kind), WHOLE, f"not printed: object number 3 ({kind})")
       for kind in ("modifier_part", "support_enforcer", "support_blocker")},
    "bambu negative": (TWO_PARTS, bambu("negative_part"), CUT, "negative volume is taken away from object pair"),
    "bambu in two files": (ELSEWHERE, SUB_MODEL | bambu("negative_part"), CUT, "taken away from object pair"),
    "cura 1": (cura("infill_mesh", "1"), {}, WHOLE, "object extra (infill_mesh)"),
    **{f"cura {kind}": (cura(kind), {}, WHOLE, f"object extra ({kind})")
       for kind in ("infill_mesh", "cutting_mesh", "anti_overhang_mesh", "support_mesh")},
}  # fmt: skip
NAMESPACES = (
    'xmlns:cura="http://software.ultimaker.com/xml/cura/3mf/2015/10" '
    'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
)


@pytest.mark.parametrize("case", ROLES)
def test_only_parts_print_and_negative_volumes_are_taken_away(case: str, tmp_path: Path) -> None:
    (objects, items), others, volume, remark = ROLES[case]
    path = written(tmp_path, model_xml(objects, items, attributes=NAMESPACES), others)
    solid = MeshTable(shape="mesh", file=path.name).solid(Grid(nx=40, ny=30, pitch_um=100.0), tmp_path)
    assert solid.columns(40, 30, 1e-4).volume == pytest.approx(volume * 1e-9, rel=1e-6, abs=0.0)
    assert any(remark in each for each in solid.remarks), solid.remarks


@pytest.mark.parametrize(
    ("model", "others"),
    [
        (ONE_MESH, slic3r("0", "modifier")),
        (ONE_MESH, slic3r("", "name")),
        (TWO_PARTS, {BAMBU: b'<config><object id="4"><part id="2"/><part id="3"/></object></config>'}),
        (TWO_PARTS, {BAMBU: bambu("negative_part")[BAMBU].replace(b'object id="4"', b'object id="5"')}),
        ((TWO_ITEMS[0], TWO_ITEMS[1].format(' printable="1"')), {}),
        (cura("infill_mesh", "False"), {}),
    ],
)
def test_volume_that_no_entry_makes_another_is_a_part(
    model: tuple[str, str], others: dict[str, bytes], tmp_path: Path
) -> None:
    path = written(tmp_path, model_xml(*model), others)
    solid = MeshTable(shape="mesh", file=path.name).solid(Grid(nx=40, ny=50, pitch_um=100.0), tmp_path)
    assert solid.columns(40, 50, 1e-4).volume == pytest.approx((6.0 + 7.0 - 1.5) * 1e-9, rel=1e-6, abs=0.0)


def test_negative_volume_moves_with_its_object_and_spares_others(tmp_path: Path) -> None:
    """A copy that is mirrored and one that is turned, and an object that stands where a volume is negative."""
    mirrored, turned = "-1 0 0 0 1 0 0 0 1 3 0 0", "0 1 0 -1 0 0 0 0 1 7 0 0"
    items = "".join(f'<item objectid="4" transform="{each}"/>' for each in (mirrored, turned)) + '<item objectid="5"/>'
    objects = TWO_PARTS[0] + mesh_object(5, meshes.box((1.6, 0.5, 0.0), (1.8, 1.0, 1.0)))
    found = load(written(tmp_path, model_xml(objects, items), bambu("negative_part")), 90, 50, 1e-4)
    assert found.volume == pytest.approx((2 * CUT + 0.2 * 0.5 * 0.75) * 1e-9, rel=1e-6, abs=0.0)
    tops = found.top(*cell_centers(90, 50, 1e-4)) * 1e3  # the lowest x and y of the part are at 9.5 cells
    for at, top in (((17, 20), 1.0), ((30, 20), 0.25), ((70, 12), 1.0), ((70, 20), 0.25), ((27, 17), 1.0)):
        assert tops[at] == pytest.approx(top, rel=1e-6, abs=0.0), at


LEFT: dict[str, tuple[tuple[Any, Any], dict[str, Any], int, tuple[float, float, float], float]] = {
    "slot across x": (((1.2, -1, -1), (1.6, 3, 3)), {"rotate_deg": [0.0, 0.0, 90.0], "scale": 2.0}, 2, (4, 6, 2), 41.6),
    "slot across y": (((-1, 0.9, -1), (4, 1.1, 3)), {}, 2, (3, 2, 1), 5.4),
    "first third": (((-1, -1, -1), (1, 3, 3)), {"rotate_deg": [90.0, 0.0, 0.0], "height_um": 600.0}, 1,
                    (0.6, 0.3, 0.6), 0.108),
    "side along x": (((-1, 1.5, -1), (4, 3, 3)), {"scale": 0.5}, 1, (1.5, 0.75, 0.5), 0.5625),
    "upper part": (((-1, -1, 0.25), (4, 3, 3)), {"height_um": 500.0}, 1, (6, 4, 0.5), 12.0),
    "hollow": (((1, 0.5, 0.25), (2, 1.5, 0.75)), {}, 1, (3, 2, 1), 5.5),
    "bridge": (((1, -1, -1), (2, 3, 0.7)), {}, 1, (3, 2, 1), 4.6),
}  # fmt: skip
"""Box that is taken from LOW, what turns and scales it, and pieces, sides [mm] and volume [mm3] of what is left."""


@pytest.mark.parametrize("case", LEFT)
def test_size_pieces_and_volume_are_those_of_what_negative_volumes_leave(case: str, tmp_path: Path) -> None:
    taken, options, pieces, sides, volume = LEFT[case]
    model = model_xml(mesh_object(2, np.concatenate([LOW, meshes.box(*taken)])), '<item objectid="2"/>')
    file = PartFile(written(tmp_path, model, slic3r("NegativeVolume")), **options)
    near = 1e-3 * max(sides)
    bodies = mesh_of_file(file)
    assert bodies is not None
    report = MeshReport.of(bodies)
    assert report.bodies == pieces
    assert [1e3 * side for side in report.size] == pytest.approx(sides, rel=1e-9, abs=near)
    pitch_um = 1e3 * max(sides) / 40
    part = fit(file, pitch_um)
    assert [1e-3 * side for side in part.size_um] == pytest.approx(sides, rel=1e-9, abs=near)
    assert part.solid.volume == pytest.approx(1e-9 * volume, rel=2e-3, abs=0.0)
    mask = part.solid.columns(part.grid.nx, part.grid.ny, part.grid.pitch).mask
    for axis, side in enumerate(sides[:2]):
        filled = np.flatnonzero(mask.any(axis=1 - axis))
        assert filled[0] == 2
        assert filled[-1] == mask.shape[axis] - 3
        assert abs(mask.shape[axis] - 4 - 1e3 * side / pitch_um) <= 1.0


def test_object_that_is_negative_in_one_item_is_a_part_in_another(tmp_path: Path) -> None:
    items = '<item objectid="4"/><item objectid="3" transform="1 0 0 0 1 0 0 0 1 5 0 0"/>'
    path = written(tmp_path, model_xml(TWO_PARTS[0], items), bambu("negative_part"))
    assert load(path, 90, 60, 1e-4).volume == pytest.approx((CUT + 7.0) * 1e-9, rel=1e-6, abs=0.0)


def test_material_of_an_object_is_that_of_what_prints(tmp_path: Path) -> None:
    head, *triangles = mesh_object(2, np.concatenate([LOW, TAKEN]), "part", 0).split("<triangle ")
    of_taken = [f'pid="1" p1="1" {each}' if number >= 12 else each for number, each in enumerate(triangles)]
    model = model_xml("<triangle ".join([head, *of_taken]), ONE_MESH[1], materials="stiff soft")
    (body,) = read_bodies(written(tmp_path, model, slic3r("NegativeVolume")))
    assert (body.material, body.paint) == ("stiff", ())


def test_negative_volume_is_of_the_ink_of_its_object(tmp_path: Path) -> None:
    """Of two objects with their inks the mirrored one is cut; the other stands where its mirror image would be."""
    pair = PAIR.format(OTHER).replace("pair", "cut")
    items = '<item objectid="5"/><item objectid="4" transform="-1 0 0 0 1 0 0 0 1 7 0 0"/>'
    path = written(tmp_path, model_xml(mesh_object(5, LOW, "whole") + TWO_PARTS[0].replace(PAIR.format(OTHER), pair),
                                       items), bambu("negative_part"))  # fmt: skip
    inks: dict[str, Literal["A", "B"]] = {"whole": "A", "cut": "B"}
    solid = MeshTable(shape="mesh", file=path.name, inks=inks).solid(Grid(nx=74, ny=24, pitch_um=100.0), tmp_path)
    assert solid.volume == pytest.approx((WHOLE + CUT) * 1e-9, rel=2e-3, abs=0.0)
    volumes = [found.volume for found in load_inks(path, 74, 24, 1e-4, inks).values()]
    assert volumes == pytest.approx([WHOLE * 1e-9, CUT * 1e-9], rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("part", "others", "message"),
    [
        (ONE_MESH, slic3r("Widget"), "has parts of the kind 'Widget', which is not known; export it as STL"),
        (TWO_PARTS, bambu("glass_part"), "has parts of the kind 'glass_part'"),
        (
            ONE_MESH,
            slic3r("ModelPart", last=22),
            "volumes of object 2 in Meta.*config do not hold its 24 tri",
        ),
        (ONE_MESH, slic3r("ModelPart", last=24), "volumes of object 2 in Meta.*config do not hold its 24 tri"),
        (ONE_MESH, {"Metadata/Slic3r_PE_sla_drain_holes.txt": b"v=1\nobject_id=1|0 0 0"}, "has drain holes"),
        (ONE_MESH, {PRUSA: b'<!DOCTYPE a [<!ENTITY b "c">]><config/>'}, "declares a document type"),
        ((TWO_ITEMS[0], '<item objectid="3" printable="0"/>'), {}, "not printed: object extra .*; nothing is left"),
    ],
)
def test_slicer_entries_that_cannot_be_obeyed_are_refused(
    part: tuple[str, str], others: dict[str, bytes], message: str, tmp_path: Path
) -> None:
    with pytest.raises(GeometryError, match=message):
        read_bodies(written(tmp_path, model_xml(*part), others))


def test_warnings_that_touch_no_shape_are_told(tmp_path: Path) -> None:
    metadata = (
        '<metadata name="Colour">x</metadata><metadata name="Title">a</metadata><metadata name="Title">b</metadata>'
    )
    model = model_xml(mesh_object(2, LOW), '<item objectid="2"/>', attributes=NAMESPACES)
    (body,) = read_bodies(written(tmp_path, model.replace("<resources>", metadata + "<resources>")))
    told = " ".join(body.remarks)
    assert all(each in told for each in ("Duplicate Model Metadata", "Unknown Model Metadata", "UUID")), body.remarks
    assert body.volume == pytest.approx(6e-9, rel=1e-6, abs=0.0)
