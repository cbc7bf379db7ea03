"""Folders of bitmaps hold exactly what a run jetted, or what its open loop plans, for other readers too."""

from __future__ import annotations

import hashlib
import io
import json
import struct
from argparse import Namespace
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tools import parts

from inkloop.cli import main
from inkloop.component import Ink
from inkloop.exchange.layers import BITMAP_FORMATS, archive
from inkloop.exchange.layers.bitmap import encode, stored_pitch
from inkloop.exchange.layers.patterns import Patterns, of_open_loop, of_run
from inkloop.printing.run import print_part
from inkloop.report.terminal import Terminal
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.tables import part_layers as layer_manifest
from inkloop.tables.schema import Process
from support.bitmap_readers import png_chunks, stored_bits
from support.places import SCENARIOS

LITTLE = {"components.controller.annealing_sweeps": 0, "run.layers_max": 2}
GREY = {"components.controller.drop_levels": 5, "components.controller.horizon": 1}
FOUR_PASSES = {"process.passes": 4, "process.pass_order": "diagonal", "process.pass_rotation": 1}


@cache
def printed(name: str, *changes: tuple[str, Any]) -> Result:
    return print_part(Scenario.load(SCENARIOS / f"{name}.toml", {**LITTLE, **dict(changes)}))


@cache
def two_inks_in_four_passes() -> Result:
    """Three layers of the open loop, of which the third has both inks."""
    whole = Scenario.load(SCENARIOS / "two-materials.toml", {**FOUR_PASSES, "run.layers_max": 3})
    return print_part(whole.variant("open loop"))


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("printed") / "run"
    printed("cuboid").save(folder)
    return str(folder)


def manifest_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / layer_manifest.NAME).read_text())


def planes(folder: Path, form: str = "tiff") -> list[tuple[dict[str, Any], np.ndarray]]:
    """Each entry of the manifest with the (nx, ny) bits of its file, which has the declared hash."""
    found, manifest = [], manifest_of(folder)
    layers = [entry["layer"] for entry in manifest["files"]]
    assert (manifest["image_format"], manifest["first_layer"], manifest["last_layer"]) == (form, layers[0], layers[-1])
    for entry in manifest["files"]:
        content = (folder / entry["file"]).read_bytes()
        assert entry["sha256"] == hashlib.sha256(content).hexdigest()
        bits = stored_bits(content, form).T
        assert (manifest["width_pixels"], manifest["height_pixels"]) == bits.shape
        assert entry["pixels"] == bits.sum()
        assert entry["drops"] == entry["drops_per_pixel"] * bits.sum()
        found.append((entry, bits))
    assert len(list(folder.iterdir())) == len(found) + 1
    return found


@pytest.mark.parametrize("form", ["tiff", "png", "bmp"])
def test_bitmaps_are_the_pattern_and_their_sums_are_the_counted_droplets(form: str, tmp_path: Path) -> None:
    result = two_inks_in_four_passes()
    archive.write(of_run(result, "run"), tmp_path / "out", form=form, layers=[1, 2, 3], passes=True)
    pattern = np.zeros_like(result.dataset.pattern.values)
    counted = np.zeros((4, 2), int)
    for entry, bits in planes(tmp_path / "out", form):
        ink = "AB".index(entry["ink"])
        assert not pattern[entry["layer"]][bits].any(), "a site in two bitmaps"
        pattern[entry["layer"]] += (ink + 1) * bits
        counted[entry["layer"], ink] += entry["drops"]
    assert np.array_equal(pattern, result.dataset.pattern.values)
    droplets = np.column_stack([result.dataset.droplets_a.values, result.dataset.droplets_b.values])
    assert np.array_equal(np.cumsum(counted, axis=0), droplets)
    assert droplets[-1].all()
    manifest, inks = manifest_of(tmp_path / "out"), Scenario.load(SCENARIOS / "two-materials.toml").job().inks
    assert (manifest["passes"], manifest["drop_levels"], manifest["drop_split"]) == (4, 1, None)
    heights = {ink: about["layer_height_um"] for ink, about in manifest["inks"].items()}
    assert heights == pytest.approx(
        {"A": inks[0].layer_height * 1e6, "B": inks[1].layer_height * 1e6}, rel=1e-12, abs=0.0
    )
    assert heights["A"] != heights["B"]


def test_passes_are_numbered_as_they_are_jetted(tmp_path: Path) -> None:
    """Diagonal order 0, 3, 1, 2, each layer begins one place later: 3, 1, 2, 0 in layer 1, 1, 2, 0, 3 in layer 2."""
    archive.write(of_run(two_inks_in_four_passes(), "run"), tmp_path / "out", form="png", layers=[1, 2], passes=True)
    colours = {(entry["layer"], entry["pass"]): entry["colour"] for entry, _ in planes(tmp_path / "out", "png")}
    assert [colours[1, number] for number in (1, 2, 3, 4)] == [3, 1, 2, 0]
    assert [colours[2, number] for number in (1, 2, 3, 4)] == [1, 2, 0, 3]
    for entry, bits in planes(tmp_path / "out", "png"):
        i, j = np.nonzero(bits)
        assert {(int(a) % 2, int(b) % 2) for a, b in zip(i, j, strict=True)} <= {divmod(entry["colour"], 2)}


@pytest.mark.parametrize("split", ["planes", "bits", None])
def test_drops_of_several_sizes_add_up(split: str | None, tmp_path: Path) -> None:
    result = printed("cuboid", *GREY.items())
    archive.write(of_run(result, "run"), tmp_path / "out", form="bmp", layers=[1, 2], split=split)
    drops = np.zeros_like(result.dataset.pattern.values)
    for entry, bits in planes(tmp_path / "out", "bmp"):
        drops[entry["layer"]] += entry["drops_per_pixel"] * bits
    jetted = np.where(result.dataset.pattern.values > 0, result.dataset.drop_level.values, 0)
    assert np.array_equal(drops, jetted)
    assert jetted.max() > 3
    assert np.array_equal(np.cumsum(drops.sum(axis=(1, 2))), result.dataset.droplets_a.values)
    names = {entry["file"] for entry, _ in planes(tmp_path / "out", "bmp")}
    manifest = manifest_of(tmp_path / "out")
    assert (manifest["drop_levels"], manifest["drop_split"]) == (jetted.max(), split or "planes")
    most = int(jetted.max())
    parts = [f"b{bit}" for bit in range(3)] if split == "bits" else [f"d{level}" for level in range(1, most + 1)]
    assert 4 <= most <= 7, "three bits"
    assert names == {f"L000{layer}_P1_A_{part}.bmp" for layer in (1, 2) for part in parts}
    if split != "bits":
        assert not np.logical_and.reduce([bits for entry, bits in planes(tmp_path / "out", "bmp")][:2]).any()


def test_manifest_describes_the_folder(run_folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result, command = printed("cuboid"), ["export", "layers", run_folder, "--layers", "2", "--format", "png"]
    assert main([*command, "--json", "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    assert "layers 2 to 2, bitmaps: 1" in shown.err
    assert json.loads(shown.out)["files"] == ["L0002_P1_A.png"]
    manifest = manifest_of(tmp_path / "out")
    assert (manifest["width_pixels"], manifest["height_pixels"]) == (12, 12)
    assert manifest["pitch_x_um"] == pytest.approx(result.dataset.attrs["pitch"] * 1e6, rel=1e-11, abs=0.0)
    assert manifest["pitch_y_um"] == manifest["pitch_x_um"]
    assert manifest["pitch_of_resolution_um"] == pytest.approx(1e6 / 3799, rel=1e-11, abs=0.0)
    assert manifest["inks"]["A"]["drop_volume_pl"] == pytest.approx(263.256**2 * 7.6e-3, rel=1e-9, abs=0.0)
    assert manifest["inks"]["A"]["layer_height_um"] == pytest.approx(7.6, rel=1e-12, abs=0.0)
    assert manifest["scenario_sha256"] == result.run["sha256"]["scenario"]
    assert [entry["file"] for entry in manifest["files"]] == ["L0002_P1_A.png"]


LEVELS = np.array([[[1, 2, 9], [2, 1, 0]]])
DROPS = Patterns(
    "by hand",
    "",
    1e-4,
    (Ink(), Ink()),
    Process(passes=4),
    np.array([[[1, 1, 0], [2, 0, 1]]]),
    LEVELS,
)
"""Of two inks, a layer of 2 x 3 cells; no droplet where the level is 9."""


def test_sizes_of_drops_are_those_of_the_droplets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Written next to the reader, under the name of the folder, however it is named."""
    assert DROPS.levels == 2
    assert replace(DROPS, drop_level=None).levels == 1
    assert replace(DROPS, pattern=0 * DROPS.pattern).levels == 1
    (tmp_path / "plate").mkdir()
    monkeypatch.chdir(tmp_path / "plate")
    options = Namespace(out=None, format="png", layers=None, passes=False, drop_levels="bits")
    assert archive.export(DROPS, Path(), options, Terminal(as_json=True)) == 0
    streams = capsys.readouterr()
    assert json.loads(streams.out)["drops"] == 5
    assert "wrote plate-layers: layers 1 to 1, bitmaps: 4, drops: 5; by hand" in streams.err
    found = {entry["file"]: bits for entry, bits in planes(Path("plate-layers"), "png")}
    assert list(found) == ["L0001_P1_A_b0.png", "L0001_P1_A_b1.png", "L0001_P1_B_b0.png", "L0001_P1_B_b1.png"]
    assert [np.argwhere(bits).tolist() for bits in found.values()] == [[[0, 0]], [[0, 1]], [], [[1, 0]]]
    assert manifest_of(Path("plate-layers"))["passes"] == 1
    with Image.open("plate-layers/L0001_P1_B_b1.png") as picture:
        assert picture.info["Title"] == "layer 1, pass 1, ink B, b1"


def test_droplet_of_a_run_without_a_size_is_one_drop() -> None:
    result = printed("cuboid", *GREY.items())
    bare = result.dataset.assign(drop_level=0 * result.dataset.drop_level)
    assert (of_run(Result(bare, result.run), "run").drop_level == 1).all()


def test_run_in_two_inks_has_two_although_its_file_names_one() -> None:
    result = printed("cuboid")
    assert len(of_run(result, "run").inks) == 1
    both = result.dataset.assign(ink=result.dataset.pattern)
    assert of_run(Result(both, result.run), "run").inks == (Ink(), Ink())


def test_layers_that_were_aborted_are_marked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = printed("cuboid")
    whole = result.dataset.assign(layer_unknown=("layer", np.array([False, False, True])))
    Result(whole, result.run).save(tmp_path / "run")
    for layers, unknown in (("1", []), ("1-2", [2])):
        out = tmp_path / layers
        assert main(["export", "layers", str(tmp_path / "run"), "--layers", layers, "--out", str(out)]) == 0
        assert manifest_of(out)["unknown_layers"] == unknown
        assert ("what of them was jetted is unknown: 2" in capsys.readouterr().out) == bool(unknown)


def test_a_part_becomes_layers_without_a_scenario(tmp_path: Path) -> None:
    """A box of 6 x 4 cells and three layers."""
    (tmp_path / "box.stl").write_bytes(parts.stl(parts.box((0.0, 0.6), (0.0, 0.4), 0.0, 0.0228)))
    out = tmp_path / "out"
    command = ["export", "layers", str(tmp_path / "box.stl"), "--pitch-um", "100", "--format", "png", "--out", str(out)]
    assert main(command) == 0
    found = planes(out, "png")
    assert [(entry["layer"], entry["drops"]) for entry, _ in found] == [(1, 24), (2, 24), (3, 24)]
    assert manifest_of(out)["pitch_x_um"] == 100.0
    assert main([*command[:-1], str(tmp_path / "less"), "--set", "run.layers_max=2"]) == 0
    assert manifest_of(tmp_path / "less")["last_layer"] == 2


@pytest.mark.parametrize(
    ("name", "variant"), [("cuboid", "open loop"), ("pipe-junction", "open loop"), ("cylinder-open-loop", None)]
)
def test_planned_patterns_are_those_that_the_open_loop_run_jets(name: str, variant: str | None) -> None:
    whole = Scenario.load(SCENARIOS / f"{name}.toml", {"run.layers_max": 7})
    run = print_part(whole.variant(variant) if variant else whole)
    planned = of_open_loop(whole)
    assert np.array_equal(planned.pattern, run.dataset.pattern.values[1:])
    assert len(planned.pattern) == run.metrics()["layers"]


def test_a_scenario_without_an_open_loop_gets_full_layers_to_its_height_else_its_options_count() -> None:
    """A cuboid in layers of 7.6 um, of which half a one is not printed; two layers, as the comparison run has it."""
    text = (SCENARIOS / "cuboid.toml").read_text().partition("[compare.")[0]
    planned = of_open_loop(Scenario.of_text(text, str(SCENARIOS / "cuboid.toml"), {"part.height_um": 25.0}))
    assert planned.pattern.shape == (3, 12, 12)
    assert np.array_equal(planned.pattern[0], planned.pattern[2])
    assert planned.pattern.sum() == 3 * 64
    own = {"part.height_um": 25.0, "components.controller": {"kind": "OpenLoop", "layers": 2}}
    text = text.replace("alpha = 0.8\n", "")
    mine = of_open_loop(Scenario.of_text(text, str(SCENARIOS / "cuboid.toml"), own | {"label": "mine"}))
    assert len(mine.pattern) == 2
    assert mine.origin.endswith(", mine")
    changes = {"compare": {"open loop": {"components": {"controller": {"layers": 2}}}}}
    assert len(of_open_loop(Scenario.load(SCENARIOS / "cuboid.toml", changes)).pattern) == 2


def test_a_failed_export_leaves_nothing_and_an_existing_folder_is_kept(
    run_folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither the folder nor a temporary one, whatever ends the writing."""

    def interrupt(layer: int) -> None:
        raise KeyboardInterrupt

    patterns = of_run(printed("cuboid"), "run")
    with pytest.raises(KeyboardInterrupt):
        archive.write(patterns, tmp_path / "new" / "out", form="png", layers=[1, 2], on_layer=interrupt)
    assert list((tmp_path / "new").iterdir()) == []
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("kept")
    assert main(["export", "layers", run_folder, "--out", str(tmp_path / "out")]) == 1
    assert "is there already" in capsys.readouterr().err
    with pytest.raises(FileExistsError):
        archive.write(patterns, tmp_path / "out", form="png", layers=[1])
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--layers", "0-1"], "within layers 1 to 2"),
        (["--layers", "2-3"], "within layers 1 to 2"),
        (["--layers", "2-1"], "within layers 1 to 2"),
        (["--layers", "all"], "expected A-B"),
        (["--passes"], "a layer is one pass here"),
        (["--set", "seed=2"], "--set goes with a scenario"),
        (["--pitch-um", "50"], "--pitch-um: goes with the file of a part"),
    ],
)
def test_wrong_options_are_refused(
    arguments: list[str], message: str, run_folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["export", "layers", run_folder, *arguments, "--out", str(out)]) == 1
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_part_without_a_droplet_has_no_layers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    low = ["--set", "part.height_um=3.0", "--out", str(tmp_path / "out")]
    assert main(["export", "layers", str(SCENARIOS / "cuboid.toml"), *low]) == 1
    assert "no layer of the part needs a droplet: its height is less than half of a layer" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_folders_that_hold_no_patterns_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = printed("cuboid")
    (tmp_path / "foreign").mkdir()
    Result(result.dataset.drop_vars("pattern"), result.run).save(tmp_path / "without")
    Result(result.dataset.isel(layer=slice(0, 1)), result.run).save(tmp_path / "begun")
    result.save(tmp_path / "damaged")
    content = (tmp_path / "damaged" / "result.nc").read_bytes()
    (tmp_path / "damaged" / "result.nc").write_bytes(content[: len(content) // 2])
    for name, message in {
        "foreign": "holds no run.json",
        "without": "holds no pattern",
        "begun": "holds no pattern",
        "damaged": "cannot be read",
    }.items():
        assert main(["export", "layers", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 1
        shown = capsys.readouterr().err
        assert message in shown
        assert str(tmp_path / name) in shown
        assert not (tmp_path / "out").exists()


DROPLETS = np.eye(9, 5, dtype=np.bool_)


def shown(content: bytes) -> np.ndarray:
    """(rows, columns), true where the picture is black."""
    with Image.open(io.BytesIO(content)) as picture:
        return np.asarray(picture.convert("L")) == 0


@pytest.mark.parametrize("form", BITMAP_FORMATS)
@pytest.mark.parametrize("shape", [(1, 1), (8, 3), (9, 2), (32, 5), (33, 40), (100, 64)])
def test_bits_survive(form: str, shape: tuple[int, int]) -> None:
    for share in (0.0, 0.02, 0.5, 1.0):
        droplets = np.random.default_rng(1).random(shape) < share
        content = encode(droplets, 263.256e-6, form, "random")
        assert np.array_equal(stored_bits(content, form), droplets.T)
        assert np.array_equal(shown(content), droplets.T)


@given(st.floats(1e-6, 1e-3))
def test_resolution_of_tiff_gives_the_pitch(pitch: float) -> None:
    with tifffile.TiffFile(io.BytesIO(encode(DROPLETS, pitch, "tiff", "F"))) as file:
        page = file.pages.first
        assert page.resolutionunit == 3
        for per_cm in page.resolution:
            assert 0.01 / per_cm == pytest.approx(pitch, rel=1e-6, abs=0.0)
        text = page.description
    assert float(text.partition("pitch_um = ")[2]) == pytest.approx(pitch * 1e6, rel=1e-11, abs=0.0)


@given(st.floats(1e-6, 1e-3))
def test_resolution_of_png_and_bmp_is_the_nearest_whole_number_per_metre(pitch: float) -> None:
    per_metre = round(1.0 / pitch)
    chunks = png_chunks(encode(DROPLETS, pitch, "png", "F"))
    assert struct.unpack(">IIB", chunks[b"pHYs"]) == (per_metre, per_metre, 1)
    bmp = encode(DROPLETS, pitch, "bmp", "F")
    assert struct.unpack_from("<ii", bmp, 38) == (per_metre, per_metre)
    with Image.open(io.BytesIO(encode(DROPLETS, pitch, "png", "F"))) as picture:
        assert float(picture.info["pitch_um"]) == pytest.approx(pitch * 1e6, rel=1e-11, abs=0.0)
    for form in ("png", "bmp"):
        assert stored_pitch(pitch, form) == pytest.approx(1.0 / per_metre, rel=1e-15, abs=0.0)
        assert stored_pitch(pitch, form) == pytest.approx(pitch, rel=0.6 * pitch, abs=0.0)
