"""3MF: bodies with names, materials and transforms; inks by name; packages that are refused."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from inkloop.errors import GeometryError
from inkloop.geometry import load, load_inks
from inkloop.geometry.mesh_file import read_bodies
from support import meshes
from support.three_mf import mesh_object, model_xml, package

pytest.importorskip("lib3mf")

LOW, HIGH = meshes.box((0, 0, 0), (3, 2, 1)), meshes.box((0, 0, 1), (3, 2, 2))
TWO = mesh_object(2, LOW, "ground", 0) + mesh_object(3, HIGH, "cover", 1)
ITEMS = '<item objectid="2"/><item objectid="3"/>'


def written(folder: Path, model: str | bytes, others: dict[str, bytes] | None = None) -> Path:
    path = folder / "part.3mf"
    path.write_bytes(package(model, others))
    return path


def test_bodies_have_names_materials_and_the_unit_of_the_file(tmp_path: Path) -> None:
    ground, cover = read_bodies(written(tmp_path, model_xml(TWO, ITEMS, "inch", materials="stiff soft")))
    assert (ground.name, ground.material, cover.name, cover.material) == ("ground", "stiff", "cover", "soft")
    assert cover.volume == pytest.approx(6 * 0.0254**3, rel=1e-6, abs=0.0)
    assert cover.triangles[..., 2].min() == pytest.approx(0.0254, rel=1e-6, abs=0.0)
    with pytest.raises(GeometryError, match="states coordinates in in, but unit is 'mm'"):
        read_bodies(tmp_path / "part.3mf", "mm")


def test_components_and_transforms_place_copies(tmp_path: Path) -> None:
    """An object twice in an assembly, once mirrored, which is moved by its item."""
    parts = '<component objectid="2"/><component objectid="2" transform="-1 0 0 0 1 0 0 0 1 8 0 5"/>'
    assembly = f'<object id="4" type="model" name="pair"><components>{parts}</components></object>'
    item = '<item objectid="4" transform="0 1 0 -1 0 0 0 0 1 10 0 0"/>'
    one, other = read_bodies(written(tmp_path, model_xml(mesh_object(2, LOW) + assembly, item)))
    assert (one.name, other.name) == ("pair", "pair")
    for body, low, high in ((one, (8, 0, 0), (10, 3, 1)), (other, (8, 5, 5), (10, 8, 6))):
        np.testing.assert_allclose(body.triangles.min(axis=(0, 1)) * 1e3, low, atol=1e-6)
        np.testing.assert_allclose(body.triangles.max(axis=(0, 1)) * 1e3, high, atol=1e-6)
        assert body.volume == pytest.approx(6e-9, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    "inks", [{"ground": "A", "cover": "B"}, {"stiff": "A", "soft": "B"}, {"ground": "A", "soft": "B"}]
)
def test_inks_go_by_object_or_material(tmp_path: Path, inks: dict[str, str]) -> None:
    path = written(tmp_path, model_xml(TWO, ITEMS, materials="stiff soft"))
    regions = load_inks(path, 40, 30, 1e-4, inks)
    whole = load(path, 40, 30, 1e-4)
    assert list(regions) == ["A", "B"]
    assert (regions["A"].height, regions["B"].height) == pytest.approx((1e-3, 2e-3), rel=1e-9, abs=0.0)
    assert (regions["A"] & regions["B"]).volume == 0.0
    np.testing.assert_array_equal((regions["A"] | regions["B"]).tops, whole.tops)


def test_ink_of_an_object_comes_before_that_of_its_material_and_names_have_to_agree(tmp_path: Path) -> None:
    both_stiff = mesh_object(2, LOW, "ground", 0) + mesh_object(3, HIGH, "cover", 0)
    path = written(tmp_path, model_xml(both_stiff, ITEMS, materials="stiff soft"))
    regions = load_inks(path, 40, 30, 1e-4, {"stiff": "A", "cover": "B"})
    assert (regions["A"].height, regions["B"].height) == pytest.approx((1e-3, 2e-3), rel=1e-9, abs=0.0)
    path = written(tmp_path, model_xml(TWO, ITEMS, materials="stiff soft"))
    message = "object 'cover' of material 'soft' has no ink.*inks: no object or material is called 'grond'.*'?ground"
    with pytest.raises(GeometryError, match=f"(?s){message}"):
        load_inks(path, 40, 30, 1e-4, {"ground": "A", "grond": "B"})


def test_mesh_without_a_name_has_that_of_the_object_around_it(tmp_path: Path) -> None:
    parts = '<component objectid="2"/><component objectid="3"/>'
    pair = f'<object id="4" type="model" name="pair"><components>{parts}</components></object>'
    model = model_xml(mesh_object(2, LOW, "ground") + mesh_object(3, HIGH) + pair, '<item objectid="4"/>')
    assert [body.name for body in read_bodies(written(tmp_path, model))] == ["ground", "pair"]


def painted(triangles: str, found: int, attribute: str) -> str:
    """The XML of an object whose triangle `found` has another attribute."""
    first, *others = triangles.split("<triangle ")
    return "<triangle ".join([first, *(f"{attribute} {one}" if n == found else one for n, one in enumerate(others))])


@pytest.mark.parametrize(
    ("attribute", "materials", "names"),
    [
        ('pid="1" p1="1"', 0, "'stiff', 'soft'"),
        ('pid="1" p1="1"', None, "none, 'soft'"),
        ('pid="1" p1="0" p2="1" p3="0"', 0, "'stiff', 'soft'"),
        ('s:mmu_segmentation="8"', 0, "'stiff', 'colours of a slicer'"),
        ('paint_color="8"', 0, "'stiff', 'colours of a slicer'"),
    ],
)
def test_objects_with_painted_triangles_are_named(
    attribute: str, materials: int | None, names: str, tmp_path: Path
) -> None:
    """Unless they are given an ink as a whole."""
    objects = mesh_object(2, LOW, "ground", 0) + painted(mesh_object(3, HIGH, "cover", materials), 4, attribute)
    slicer = 'xmlns:s="http://schemas.slic3r.org/3mf/2017/06"'
    path = written(tmp_path, model_xml(objects, ITEMS, attributes=slicer, materials="stiff soft"))
    with pytest.raises(GeometryError) as caught:
        load_inks(path, 40, 30, 1e-4, {"stiff": "A", "soft": "B"})
    message = f"object 'cover' has triangles of several materials ({names}), but an object is of one ink: make each"
    assert message in str(caught.value)
    assert "'ground'" not in str(caught.value)
    assert list(load_inks(path, 40, 30, 1e-4, {"ground": "A", "cover": "B"})) == ["A", "B"]


def test_object_painted_all_over_is_of_that_material(tmp_path: Path) -> None:
    cover = mesh_object(3, HIGH, "cover").replace("<triangle ", '<triangle pid="1" p1="1" ')
    path = written(tmp_path, model_xml(mesh_object(2, LOW, "ground", 0) + cover, ITEMS, materials="stiff soft"))
    assert [(body.material, body.paint) for body in read_bodies(path)] == [("stiff", ()), ("soft", ())]


@pytest.mark.parametrize(
    ("prefix", "namespace", "message"),
    [
        ("s", "schemas.microsoft.com/3dmanufacturing/slice/2015/07", "extension s .*slice"),
        ("v", "schemas.3mf.io/3dmanufacturing/volumetric", r"3D/3dmodel.model requires the extension v \(http.*volum"),
        ("q", "", r"extension q \(q\), which is not read"),
    ],
)
def test_required_extensions_that_are_not_read_are_refused(
    prefix: str, namespace: str, message: str, tmp_path: Path
) -> None:
    declared = f'xmlns:{prefix}="http://{namespace}" ' if namespace else ""
    model = model_xml(TWO, ITEMS, attributes=f'{declared}requiredextensions="{prefix}"', materials="stiff soft")
    with pytest.raises(GeometryError, match=message):
        read_bodies(written(tmp_path, model))


def test_attributes_of_a_slicer_are_skipped(tmp_path: Path) -> None:
    model = model_xml(mesh_object(2, LOW), '<item objectid="2" printable="1"/>')
    painted = model.replace('<triangle v1="0"', '<triangle paint_color="4" v1="0"')
    (body,) = read_bodies(written(tmp_path, painted, {"Metadata/slicer.config": b"; layer_height = 0.2"}))
    assert body.volume == pytest.approx(6e-9, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("found", "put", "message"),
    [
        ("<triangles>", "<triangles><quad/>", "would leave out: Invalid Element"),
        ("millimeter", "parsec", "would leave out: Invalid Model Unit"),
        ('v1="0"', 'v1="99"', "Invalid model node index"),
        ('x="3.0"', 'x="nan"', "Invalid Model Coordinates"),
    ],
)
def test_models_that_cannot_be_read_whole_are_refused(tmp_path: Path, found: str, put: str, message: str) -> None:
    model = model_xml(mesh_object(2, LOW), '<item objectid="2"/>')
    assert found in model
    with pytest.raises(GeometryError, match=message):
        read_bodies(written(tmp_path, model.replace(found, put)))


def test_entities_are_refused_before_they_are_read(tmp_path: Path) -> None:
    model = model_xml(TWO, ITEMS, materials="stiff soft")
    bomb = model.replace("<model", '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><model')
    for text, reason in (
        (bomb, r"declares a document type \(DOCTYPE\)"),
        (model.encode("utf-16"), "is UTF-16"),
    ):
        with pytest.raises(GeometryError, match=f"3D/3dmodel.model {reason}"):
            read_bodies(written(tmp_path, text))


def test_part_of_any_name_is_checked(tmp_path: Path) -> None:
    """The relations of a package say which part is the model, its suffix does not."""
    model = model_xml(TWO, ITEMS, materials="stiff soft")
    slices = model.replace("<model", '<model xmlns:s="urn:slices" requiredextensions="s"')
    for text, reason in (
        (slices, r"requires the extension s \(urn:slices\)"),
        (f"<!DOCTYPE m>{model}", "declares a doc"),
    ):
        path = written(tmp_path, model, {"3D/other.part": text.encode()})
        with pytest.raises(GeometryError, match=f"3D/other.part {reason}"):
            read_bodies(path)


def test_packages_that_unpack_to_too_much_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("inkloop.limits.PLAIN_SIZE", 1 << 20)
    path = written(tmp_path, model_xml(TWO, ITEMS, materials="stiff soft"), {"Metadata/noise.bin": bytes(4 << 20)})
    with pytest.raises(GeometryError, match=r"unpacks to 4\.?\d* MiB, \d+ times its size"):
        read_bodies(path)


def test_memory_of_a_file_is_asked_for_by_its_unpacked_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve times."""
    monkeypatch.setattr("inkloop.geometry.mesh_file.memory_error", lambda needed: f"needs {needed} bytes")
    path = written(tmp_path, model_xml(TWO, ITEMS, materials="stiff soft"))
    with zipfile.ZipFile(path) as archive:
        whole = sum(len(archive.read(name)) for name in archive.namelist())
    assert whole > 2 * path.stat().st_size
    (tmp_path / "part.stl").write_bytes(bytes(100))
    for name, size in ((path.name, whole), ("part.stl", 100)):
        with pytest.raises(GeometryError, match=f"needs {12 * size} bytes"):
            read_bodies(tmp_path / name, "mm")


def test_copies_of_copies_are_counted_before_they_are_made(tmp_path: Path) -> None:
    """Eight objects, each ten times the one before."""
    objects = mesh_object(2, LOW)
    for number in range(3, 11):
        parts = f'<component objectid="{number - 1}"/>' * 10
        objects += f'<object id="{number}" type="model"><components>{parts}</components></object>'
    with pytest.raises(GeometryError, match=r"its components are 1e\+08 copies of its meshes; at most 1,000,000"):
        read_bodies(written(tmp_path, model_xml(objects, '<item objectid="10"/>')))


def test_copies_of_meshes_in_a_later_file_are_counted_too(tmp_path: Path) -> None:
    """Six objects there, each ten times the one before, and ten of the last one here."""
    tenfold = ["".join(f'<component objectid="{number - 1}" p:path="/3D/more.model"/>' * 10) for number in range(3, 10)]
    objects = [
        f'<object id="{number}" type="model"><components>{parts}</components></object>'
        for number, parts in enumerate(tenfold, start=3)
    ]
    produced = 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
    first = model_xml(objects[-1], '<item objectid="9"/>', attributes=produced)
    more = model_xml(mesh_object(2, LOW) + "".join(objects[:-1]), "", attributes=produced)
    with pytest.raises(GeometryError, match=r"its components are 1e\+07 copies of its meshes; at most 1,000,000"):
        read_bodies(written(tmp_path, first, {"3D/more.model": more.encode()}))


def test_copies_that_memory_cannot_hold_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: 100_000)
    model = model_xml(mesh_object(2, LOW), '<item objectid="2"/>' * 100)
    with pytest.raises(GeometryError, match=r"has 1,200 triangles in all copies of its objects: needs about"):
        read_bodies(written(tmp_path, model))
