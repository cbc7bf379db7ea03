"""Layers for a print head go back in as a part: the same cells in the same ink, or a refusal that names the file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from PIL import Image

from inkloop.cli import main
from inkloop.component import Ink
from inkloop.errors import ScenarioError
from inkloop.exchange.layers import archive
from inkloop.exchange.layers.patterns import Patterns
from inkloop.scenario.file import Scenario
from inkloop.tables.schema import Process
from support.parts import PITCH_UM, with_part

PART = 'shape = "layers"\nfile = "out/manifest.json"\n'
INK, THINNER = Ink(4.4e-6, 0.6e-6, 0.2e-6), Ink(3.9e-6, 0.55e-6, 0.15e-6)
F = np.array([[1, 1, 1, 1], [1, 0, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], bool).T[:, ::-1]
"""The letter with x to the right and y up, in ink B on ink A in the second layer."""
SLICES = np.array([np.ones(F.shape), 1 + F, np.ones(F.shape)], np.int8)


def export(
    folder: Path,
    *,
    form: str = "png",
    passes: Literal[1, 4] = 1,
    inks: tuple[Ink, ...] = (INK, INK),
    slices: Any = SLICES,
    **options: Any,
) -> dict[str, Any]:
    """Write the slices as layers; returns the manifest."""
    patterns = Patterns("test", "", PITCH_UM * 1e-6, inks, Process(passes=passes), slices, **options)
    archive.write(patterns, folder / "out", form=form, layers=[1, 2, 3], passes=passes > 1)
    found: dict[str, Any] = json.loads((folder / "out" / "manifest.json").read_text())
    return found


@pytest.mark.parametrize(("form", "passes"), [("tiff", 1), ("png", 1), ("bmp", 1), ("tiff", 4)])
def test_slices_come_back_in_their_inks(form: str, passes: Literal[1, 4], tmp_path: Path) -> None:
    export(tmp_path, form=form, passes=passes)
    job = with_part(PART, tmp_path).job()
    expected = np.zeros((job.nx, job.ny), bool)
    expected[5:9, 3:9] = True
    np.testing.assert_array_equal(job.mask, expected)
    np.testing.assert_allclose(job.target_height[expected], 3 * 7.6e-6, rtol=1e-12)
    x, y = (axis[5:9, 3:9] * PITCH_UM * 1e-6 for axis in np.meshgrid(range(job.nx), range(job.ny), indexing="ij"))
    assert job.region is not None
    for number, each in enumerate(SLICES):
        in_a = job.region.contains(x, y, np.full(F.shape, (number + 0.5) * 7.6e-6))
        np.testing.assert_array_equal(in_a, each == 1, err_msg=f"layer {number + 1}")


def test_inks_of_unequal_layers_need_the_height_of_a_slice(tmp_path: Path) -> None:
    export(tmp_path, inks=(INK, THINNER))
    with pytest.raises(ScenarioError, match=r"part\.layer_um is missing: full layers of the inks are 6.7 and 7.6 µm"):
        with_part(PART, tmp_path)
    assert with_part(PART + "layer_um = 7.0", tmp_path).solid.shape.height == pytest.approx(21e-6, rel=1e-12, abs=0.0)


def test_new_scenario_for_layers_in_two_inks_with_gaps_prints_what_rests_on_the_substrate(tmp_path: Path) -> None:
    """As a closed loop leaves them: a support needs an ink of its own, and would make the scenario invalid."""
    export(tmp_path, slices=SLICES * np.array([np.ones_like(F), F, np.ones_like(F)], np.int8))
    assert main(["new", str(tmp_path / "back"), "--part", str(tmp_path / "out" / "manifest.json")]) == 0
    back = tmp_path / "back.toml"
    grid = Scenario.load(back).tables.grid
    assert (grid.nx, grid.ny, grid.pitch_um) == (F.shape[0] + 4, F.shape[1] + 4, PITCH_UM)
    top = np.unique((Scenario.load(back).job().target_height / 7.6e-6).round(6), return_counts=True)
    assert dict(zip(*(values.tolist() for values in top), strict=True))[3.0] == F.sum()
    text = back.read_text()
    for support, words in (("", 'add [support] with kind = "none"'), ("[support]", 'set support.kind = "none"')):
        back.write_text(text.replace('[support]\nkind = "none"', support))
        with pytest.raises(ScenarioError) as found:
            Scenario.load(back)
        assert words in str(found.value)
        assert "which print ink B there" not in str(found.value)


def without_layer(number: int) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    return lambda manifest: {"files": [one for one in manifest["files"] if one["layer"] != number]}


def with_twice_the_first(manifest: Mapping[str, Any]) -> dict[str, Any]:
    first, *others = manifest["files"]
    return {"files": [first, {**others[0], "file": first["file"], "sha256": first["sha256"]}, *others[1:]]}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda manifest: {"format": "other"}, "is no manifest of `inkloop export layers`: format is 'other'"),
        (lambda manifest: {"format_version": 2}, "format_version is 2; expected 1"),
        (lambda manifest: {"polarity": "white"}, "polarity is 'white'; expected 'a set bit is a droplet"),
        (lambda manifest: {"first_row": "top"}, "first_row is 'top'; expected 'y = 0; rows"),
        (lambda manifest: {"drop_levels": 2}, "drop_levels is 2: drops of several sizes"),
        (lambda manifest: {"pitch_x_um": 0.0}, "pitch_x_um is 0.0; expected greater than 0"),
        (lambda manifest: {"width_pixels": 5}, "manifest.json: L0001_P1_A.png has 4 x 6 pixels with values up to 1; "),
        (lambda manifest: {"inks": {"A": manifest["inks"]["A"]}}, "files are of ink B, which inks lacks"),
        (without_layer(2), "has layer 3, but not layer 2; a part needs all of them from layer 1"),
        (without_layer(1), "has layer 3, but not layer 1; a part needs all of them from layer 1"),
        (with_twice_the_first, "manifest.json: L0001_P1_A.png has a droplet in column 0, row 0, as another file"),
        (lambda manifest: {"files": [{**manifest["files"][0], "file": "../x.png"}]}, "files.[0].file is '../x.png'"),
        (lambda manifest: {"files": [{**manifest["files"][0], "file": "x.png"}]}, "x.png cannot be read: No such file"),
        (lambda manifest: {"files": []}, "files is []; "),
    ],
)
def test_bad_manifests_are_refused_by_name(
    change: Callable[[Mapping[str, Any]], dict[str, Any]], expected: str, tmp_path: Path
) -> None:
    manifest = export(tmp_path)
    (tmp_path / "out" / "manifest.json").write_text(json.dumps({**manifest, **change(manifest)}))
    with pytest.raises(ScenarioError) as caught:
        with_part(PART, tmp_path)
    (error,) = caught.value.errors
    assert error.startswith("part.file: ")
    assert expected in error


def test_changed_bitmaps_and_damaged_manifests_are_refused(tmp_path: Path) -> None:
    manifest = export(tmp_path, unknown_layers=(2,))
    (remark,) = with_part(PART, tmp_path).solid.remarks
    assert remark == "layer 2 of the run was aborted; the part has it as it was commanded"
    first = manifest["files"][0]
    path = tmp_path / "out" / first["file"]
    kept = path.read_bytes()
    Image.fromarray((2 * F.T).astype(np.uint8)).save(path)
    grey = {**first, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    text = json.dumps({**manifest, "files": [grey, *manifest["files"][1:]]})
    (tmp_path / "out" / "manifest.json").write_text(text)
    with pytest.raises(ScenarioError, match=r"has 4 x 6 pixels with values up to 2; expected 4 x 6 of one bit"):
        with_part(PART, tmp_path)
    path.write_bytes(kept)
    (tmp_path / "out" / "manifest.json").write_text(json.dumps(manifest))
    changed = tmp_path / "out" / "L0002_P1_B.png"
    changed.write_bytes((tmp_path / "out" / "L0001_P1_A.png").read_bytes())
    with pytest.raises(ScenarioError, match=r"L0002_P1_B\.png was changed: its SHA-256 is"):
        with_part(PART, tmp_path)
    (tmp_path / "out" / "manifest.json").write_bytes(b'{"format": "inkl')
    with pytest.raises(ScenarioError, match=r"manifest\.json: is not JSON"):
        with_part(PART, tmp_path)
    (tmp_path / "out" / "manifest.json").write_bytes(b"1e308")
    with pytest.raises(ScenarioError, match=r"manifest\.json: is no manifest of .*: it is 1e\+308; expected a table"):
        with_part(PART, tmp_path)


@pytest.mark.parametrize("lost", [3, 4])
def test_three_lost_files_are_named_and_more_are_counted(lost: int, tmp_path: Path) -> None:
    files = [one["file"] for one in export(tmp_path)["files"]]
    for name in files[:lost]:
        (tmp_path / "out" / name).unlink()
    with pytest.raises(ScenarioError) as caught:
        with_part(PART, tmp_path)
    (error,) = caught.value.errors
    assert [name in error for name in files] == [True] * 3 + [False] * (len(files) - 3)
    assert (f"4 of {len(files)} files are missing or were changed" in error) == (lost == 4)
    assert error.count("; ") == lost - 1


def test_pixels_of_a_manifest_may_be_oblong(tmp_path: Path) -> None:
    """As wide as a cell and as high as two."""
    manifest = export(tmp_path)
    (tmp_path / "out" / "manifest.json").write_text(json.dumps({**manifest, "pitch_y_um": 2 * PITCH_UM}))
    scenario = with_part(PART, tmp_path, ny=16)
    mask = scenario.job().mask
    assert mask.sum() == F.shape[0] * 2 * F.shape[1]
    assert mask[5:9, 2:14].all()
    box = [value * 1e6 for value in scenario.solid.bounds]
    assert box == pytest.approx([450.0, 850.0, 150.0, 1350.0], rel=1e-9, abs=0.0)
