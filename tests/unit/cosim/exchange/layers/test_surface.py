"""Surfaces of runs as closed bodies and as height maps that a `MapFolder` takes back."""

from __future__ import annotations

import json
import struct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.exchange.layers.surface import closed_body, floor_of, write_body
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_folder import MapFolder
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.results.surface import surface
from inkloop.scenario.file import Scenario
from support.places import SCENARIOS

DX, DY = 2e-4, 3e-4


@cache
def cuboid() -> Scenario:
    little = {"components.controller.annealing_sweeps": 0, "run.layers_max": 2}
    noisy = {"components.profiler.dropout_rate": 0.2, "components.profiler.noise_std_um": 0.1}
    return Scenario.load(SCENARIOS / "cuboid.toml", {**little, **noisy})


@cache
def printed() -> Result:
    return print_part(cuboid())


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("printed") / "run"
    printed().save(folder)
    return str(folder)


def rough(shape: tuple[int, int] = (6, 4)) -> HeightMap:
    z = np.random.default_rng(5).normal(2e-5, 1e-5, shape)
    return HeightMap(z, DX, DY, source="rough")


def stl_corners(path: Path) -> np.ndarray:
    """(k, 3, 3) corners of a binary STL file, whose stored normals point outward."""
    content = path.read_bytes()
    count = struct.unpack_from("<I", content, 80)[0]
    assert len(content) == 84 + 50 * count
    triangles = np.frombuffer(content, np.dtype([("all", "<f4", (4, 3)), ("rest", "<u2")]), count, 84)["all"]
    corners = triangles[:, 1:].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, triangles[:, 0]) > 0.0).all()
    return corners


def glb_corners(path: Path) -> np.ndarray:
    """(k, 3, 3) corners of the one mesh of a GLB file (glTF 2.0, section 4.4)."""
    content = path.read_bytes()
    magic, version, size, json_size, kind = struct.unpack_from("<4sII I4s", content)
    assert (magic, version, size, kind) == (b"glTF", 2, len(content), b"JSON")
    tree = json.loads(content[20 : 20 + json_size])
    binary = content[20 + json_size + 8 :]
    (primitive,) = tree["meshes"][0]["primitives"]

    def numbers(accessor: int) -> np.ndarray:
        entry = tree["accessors"][accessor]
        view = tree["bufferViews"][entry["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3}[entry["type"]]
        dtype = {5125: "<u4", 5126: "<f4"}[entry["componentType"]]
        begin = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        return np.frombuffer(binary, dtype, entry["count"] * width, begin).reshape(-1, width)

    vertices = numbers(primitive["attributes"]["POSITION"]).astype(np.float64)
    return vertices[numbers(primitive["indices"])[:, 0].reshape(-1, 3)]


def check_closed(corners: np.ndarray) -> None:
    """Every directed edge once, and its reverse once."""
    keys = [tuple(corner) for corner in corners.reshape(-1, 3)]
    edges = [(keys[3 * k + a], keys[3 * k + b]) for k in range(len(corners)) for a, b in ((0, 1), (1, 2), (2, 0))]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)


def enclosed(corners: np.ndarray) -> float:
    """Volume by the divergence theorem, positive where the triangles look outward."""
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()) / 6.0


def under(map_: HeightMap, floor: float) -> float:
    """Volume between floor and surface: each square is two triangles, a prism is its area times the mean height."""
    z = map_.z - floor
    a, b, c, d = z[:-1, :-1], z[1:, :-1], z[1:, 1:], z[:-1, 1:]
    return float((map_.dx * map_.dy / 6.0 * (2.0 * a + b + 2.0 * c + d)).sum())


@pytest.mark.parametrize(("form", "scale"), [("stl", 1e3), ("glb", 1.0)])
@pytest.mark.parametrize("shape", [(2, 2), (2, 5), (6, 4)])
def test_a_body_is_closed_and_has_the_volume_of_the_map(
    form: str, scale: float, shape: tuple[int, int], tmp_path: Path
) -> None:
    map_ = rough(shape)
    write_body(tmp_path / "body", map_, form)
    corners = (stl_corners if form == "stl" else glb_corners)(tmp_path / "body") / scale
    check_closed(corners)
    assert enclosed(corners) == pytest.approx(under(map_, floor_of(map_)), rel=1e-5, abs=0.0)
    for um, floor in ((10.0, -DX), (-10.0, -1e-5 - DX)):  # a pixel, along its shorter side, below all
        for sides in ((DX, DY), (DY, DX)):
            low = np.array([[um, 30.0], [20.0, um]]) * 1e-6
            assert floor_of(HeightMap(low, *sides)) == pytest.approx(floor, rel=1e-12, abs=0.0)


def test_the_top_of_a_body_is_the_map_to_float32(tmp_path: Path) -> None:
    """In STL in mm with z up; in GLB in m with y up, so that the grid's y is -z."""
    map_ = rough()
    write_body(tmp_path / "body.stl", map_, "stl")
    write_body(tmp_path / "body.glb", map_, "glb")
    i, j = np.indices(map_.shape)
    upright = np.column_stack([i.ravel() * DX, j.ravel() * DY, map_.z.ravel()])
    turned = np.column_stack([upright[:, 0], upright[:, 2], -upright[:, 1]])
    for corners, expected in (
        (stl_corners(tmp_path / "body.stl"), upright * 1e3),
        (glb_corners(tmp_path / "body.glb"), turned),
    ):
        found = {tuple(corner) for corner in corners.reshape(-1, 3).astype(np.float32) + np.float32(0.0)}
        assert {tuple(corner) for corner in expected.astype(np.float32) + np.float32(0.0)} <= found


def test_a_body_with_holes_is_refused_and_writes_nothing(tmp_path: Path) -> None:
    z = rough().z.copy()
    z[2, 2] = np.nan
    with pytest.raises(ResultError, match="1 of 24 cells have no height"):
        write_body(tmp_path / "body.stl", HeightMap(z, DX, DY), "stl")
    for shape in ((5, 1), (1, 5)):
        with pytest.raises(ResultError, match=rf"has {shape[0]} x {shape[1]} cells; a body needs 2 x 2"):
            write_body(tmp_path / "body.stl", HeightMap(np.ones(shape), DX, DY), "stl")
    assert not list(tmp_path.iterdir())


def test_body_stands_where_its_map_lies() -> None:
    """Corners of the surface, of the foot below, and the middle of the floor."""
    map_ = HeightMap(np.array([[1e-5, 2e-5, 3e-5], [4e-5, 5e-5, 6e-5]]), DX, DY, x0=1e-3, y0=-2e-3)
    vertices, _ = closed_body(map_, -1e-4)
    corners = [(1e-3, -2e-3, 1e-5), (1e-3, -2e-3 + 2 * DY, 3e-5), (1e-3 + DX, -2e-3, 4e-5)]
    assert vertices[[0, 2, 3]].tolist() == [pytest.approx(corner, rel=1e-12, abs=0.0) for corner in corners]
    assert vertices[6].tolist() == pytest.approx((1e-3, -2e-3, -1e-4), rel=1e-12, abs=0.0)
    assert vertices[-1].tolist() == pytest.approx((1e-3 + DX / 2, -2e-3 + DY, -1e-4), rel=1e-12, abs=0.0)


def test_surface_is_named_by_run_map_and_layer_and_described(
    run_folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    lacking = int((~printed().dataset.valid.values[-1]).sum())
    assert main(["export", "surface", run_folder, "--format", "tiff", "--map", "measured", "--json"]) == 0
    streams = capsys.readouterr()
    assert [path.name for path in tmp_path.iterdir()] == ["run-measured-L0002.tif"]
    told = json.loads(streams.out)
    assert (told["file"], told["cells"], told["without_height"]) == ("run-measured-L0002.tif", [12, 12], lacking)
    assert told["pitch_um"] == pytest.approx(263.256, rel=1e-9, abs=0.0)
    assert f"12 x 12 cells of 263.256 µm, {lacking} of them without a height" in streams.err
    assert "heights in µm as float32" in streams.err
    filled = ["--map", "measured", "--layer", "1", "--fill-um", "5"]
    assert main(["export", "surface", run_folder, "--format", "npy", *filled]) == 0
    z, valid = np.load(tmp_path / "run-measured-L0001.npy"), printed().dataset.valid.values[1]
    np.testing.assert_allclose(z[~valid], 5e-6, rtol=1e-12)
    assert (np.abs(z[valid] - 5e-6) > 1e-12).all()
    assert "cells of 263.256 µm\n" in capsys.readouterr().out
    assert main(["export", "surface", run_folder, "--format", "stl", "--layer", "0"]) == 0
    assert "floor at z = -263.256 µm; lengths in mm, z up" in capsys.readouterr().out


@pytest.mark.parametrize(("form", "options"), [("sdf", {}), ("x3p", {}), ("tif", {}), ("npy", {"unit": "m"})])
def test_a_map_folder_takes_the_surface_back(
    form: str, options: dict[str, Any], run_folder: str, tmp_path: Path
) -> None:
    name = "tiff" if form == "tif" else form
    for layer in (0, 1, 2):
        out = tmp_path / f"layer_{layer:04d}.{form}"
        arguments = ["--format", name, "--layer", str(layer), "--out", str(out)]
        assert main(["export", "surface", run_folder, *arguments]) == 0
    pixel = {"pixel_um": printed().dataset.attrs["pitch"] * 1e6} if form == "npy" else {}
    folder = MapFolder(
        cuboid().job(),
        folder=str(tmp_path),
        file_name=f"layer_{{layer:04d}}.{form}",
        replay=True,
        complete="renamed",
        **options,
        **pixel,
    )
    folder.initialize(0, {"layers_printed": np.asarray(0)})
    for layer in (0, 1, 2):
        outputs = folder.do_step(layer, 1, {"layers_printed": np.asarray(layer)})
        assert outputs["layers_scanned"] == layer
        assert outputs["valid"].all()
        # cell means divide by shares of cells, which round; a float32 has 24 bits
        tolerance = 1e-6 if form == "tif" else 1e-9
        height = printed().dataset.height.values[layer]
        assert np.abs(outputs["measured_height"] - height).max() <= tolerance * np.abs(height).max()


@pytest.mark.parametrize("layer", [0, 1, 2])
def test_a_measured_surface_lacks_what_the_scan_of_its_layer_lacks(layer: int) -> None:
    run = printed().dataset
    found = surface(run, "run", name="measured", layer=layer).valid
    assert 0 < found.sum() < found.size
    np.testing.assert_array_equal(found, run.valid.values[layer])


def test_a_filled_part_becomes_a_body(run_folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["export", "surface", run_folder, "--format", "stl", "--part", "--out", str(tmp_path / "part.stl")]
    assert main(arguments) == 1
    assert "80 of 144 cells have no height" in capsys.readouterr().err
    assert main([*arguments, "--fill-um", "0"]) == 0
    assert "12 x 12 cells" in capsys.readouterr().out
    run = printed().dataset
    filled = HeightMap(np.where(run.mask.values, run.height.values[-1], 0.0), run.attrs["pitch"], run.attrs["pitch"])
    corners = stl_corners(tmp_path / "part.stl") * 1e-3
    check_closed(corners)
    assert enclosed(corners) == pytest.approx(under(filled, floor_of(filled)), rel=1e-5, abs=0.0)


def test_foreign_folders_missing_layers_and_unknown_formats_are_refused(
    run_folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "surface", run_folder, "--format", "npy", "--layer", "3", "--out", str(tmp_path / "a")]) == 1
    assert "holds no layer 3" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert main(["export", "surface", str(tmp_path), "--format", "npy"]) == 1
    assert "holds no run.json" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["export", "surface", str(tmp_path), "--format", "obj"])
    assert "'stl', 'glb', 'sdf', 'x3p', 'tiff', 'npy'" in capsys.readouterr().err
