"""Prints logged by other programs: what is read, and what is refused with a message."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray

from inkloop_lab.identify.log_folder import read_log
from inkloop_lab.identify.print_record import IdentificationError, record_of
from inkloop_lab.models import LayerDeposition, VolumeAreaDeposition
from support.logged_print import CELL, PITCH, log, made_up, random_layers

FINE = "pixel_um = 65.814\noffset_x_um = -98.721\noffset_y_um = -98.721"
PEAKS = "pitch_um = 100.0\nunit = 'um'\n"


def test_logged_print_is_the_print(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(9, 7, 3, 0))
    read = read_log(log(tmp_path / "print", record))
    assert np.array_equal(read.pattern, record.pattern)
    assert read.measured == pytest.approx(record.measured, abs=1e-14)
    assert read.pitch == pytest.approx(PITCH, rel=1e-9, abs=0.0)


def test_fine_pixels_become_cell_means_and_missing_ones_stay_missing(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(8, 6, 2, 1))
    record.measured[1, 2, 3] = np.nan
    folder = log(tmp_path / "print", record, CELL.replace("pixel_um = 263.256", FINE), 4)
    for path in folder.glob("layer_*"):
        path.write_text(path.read_text().replace("nan", ""))
    read = read_log(folder)
    assert np.isnan(read.measured[1, 2, 3])
    known = np.isfinite(record.measured)
    assert read.measured[known] == pytest.approx(record.measured[known], abs=1e-13)


def test_covered_area_is_the_share_of_pixels_above_the_threshold(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), [np.eye(8, dtype=np.int32)])
    folder = log(tmp_path / "print", record, CELL + "inked_um = 0.5\n")
    area = read_log(folder).area
    assert area is not None
    assert not area[0].any()
    assert np.array_equal(area[1] > 0.5, record.measured[1] > 0.5e-6)
    record.measured[:] += 40e-6  # a profiler that counts from elsewhere
    moved = read_log(log(tmp_path / "offset", record, CELL + "inked_um = 0.5\n")).area
    assert moved is not None
    assert np.array_equal(moved, area)


@pytest.mark.parametrize(
    ("pixels", "share", "parts"), [(5, 0.2, 5), (15, 0.2, 5), (7, 0.16, 7), (9, 0.3, 3), (3, 0.9, 1)]
)
def test_peak_heights_are_those_of_the_middle_of_so_many_parts(
    pixels: int, share: float, parts: int, tmp_path: Path
) -> None:
    """The number of parts is odd, and its inverse the share or near to it."""
    record, size = made_up(LayerDeposition(), random_layers(6, 6, 1, 1)), 100.0 / pixels
    place = "".join(f"offset_{axis}_um = {(size - 100.0) / 2}\n" for axis in "xy")
    folder = log(tmp_path / "print", record, f"{PEAKS}middle_share = {share}\npixel_um = {size}\n{place}", pixels)
    peak = np.zeros((pixels, pixels))
    peak[pixels // 2, pixels // 2] = (pixels / parts) ** 2 * 1e-6
    for layer, scan in enumerate(record.measured):
        fine = np.kron(scan, np.ones((pixels, pixels))) + np.tile(peak, (6, 6))
        np.savetxt(folder / f"layer_{layer:04d}.csv", fine.T * 1e6, fmt="%.9f", delimiter=",")
    assert read_log(folder).measured == pytest.approx(record.measured + 1e-6, abs=1e-13)


def test_level_of_every_scan_is_that_of_untouched_cells(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(16, 16, 2, 1, margin=4))
    drifted = record.measured + np.array([0.0, 5e-6, -3e-6])[:, None, None]
    exact = record.measured.copy()
    record.measured[:] = drifted
    read = read_log(log(tmp_path / "print", record, CELL + "datum = 'offset'\n"))
    assert read.measured == pytest.approx(exact, abs=1e-13)


def test_every_error_of_a_folder_is_named_at_once(tmp_path: Path) -> None:
    folder = log(tmp_path / "print", made_up(VolumeAreaDeposition(), random_layers(6, 6, 3, 0)))
    (folder / "layer_0001.csv").unlink()
    (folder / "layer_0002.csv").write_text("not a map")
    with pytest.raises(IdentificationError, match="2 errors") as caught:
        read_log(folder)
    assert "layer_0001.csv" in str(caught.value)
    (folder / "pattern_0002.csv").write_text("0,1,5\n")
    (folder / "pattern_0003.csv").write_text("a,b\n")
    with pytest.raises(IdentificationError, match=r"holds 5; expected rows and columns of 0, 1 and 2") as caught:
        read_log(folder)
    assert "pattern_0003.csv: cannot be read as a table of numbers" in str(caught.value)
    (folder / "pattern_0003.csv").write_bytes(b"0;1;\xe9\n")
    with pytest.raises(IdentificationError, match=r"pattern_0003.csv: cannot be read as a table of numbers"):
        read_log(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pitch_um = -1.0\npixels = 3\n", "2 errors"),
        ("unit = 'um'\n", "pitch_um is missing"),
        ("pitch_um = 1.0\npatterns = 'p.csv'\n", "a name with the number in it"),
        ("pitch_um = \n", "is not TOML"),
        ("pitch_um = 263.256\nunit = 'um'\n", "does not declare the size of its pixels"),
        ("pitch_um = 263.256\npixel_um = 263.256\n", "does not declare the unit"),
        (CELL + "offset_x_um = 90000.0\n", "shows no cell of the grid"),
        (CELL + "datum = 'plane'\n", "the plane needs 8"),
    ],
)
def test_invalid_description_is_refused_with_a_message(text, message, tmp_path: Path) -> None:
    folder = log(tmp_path / "print", made_up(LayerDeposition(), random_layers(6, 6, 1, 0)), text)
    with pytest.raises(IdentificationError, match=message):
        read_log(folder)


def test_folder_without_patterns_is_refused_with_a_message(tmp_path: Path) -> None:
    (tmp_path / "print.toml").write_text(CELL)
    with pytest.raises(IdentificationError, match=r"pattern_0001.csv is not there"):
        read_log(tmp_path)


PROCESS = '[process]\npasses = 4\npass_order = "diagonal"\npass_rotation = 3\n'
SHAPE = ("layer", "x", "y")


def result(layers: int, **maps: Any) -> Any:
    rng = np.random.default_rng(2)
    drawn = {
        "pattern": rng.integers(0, 3, (layers, 4, 3)).astype(np.int8),
        "measured_height": rng.random((layers, 4, 3)).astype(np.float32),
        "valid": rng.random((layers, 4, 3)) < 0.5,
        "height": rng.random((layers, 4, 3)),
    } | maps
    arrays = {name: (SHAPE, values) for name, values in drawn.items() if values is not None}
    return SimpleNamespace(dataset=xarray.Dataset(arrays, attrs={"pitch": 2e-4}), scenario_text=PROCESS)


def test_scans_count_where_they_are_valid_and_patterns_from_the_first_layer_on() -> None:
    run = result(3)
    found, data = record_of(run, "it"), run.dataset
    assert (found.name, found.pitch, found.passes, found.pass_order, found.pass_rotation) == ("it", 2e-4, 4, 2, 3)
    np.testing.assert_array_equal(found.pattern, data["pattern"].values[1:])
    np.testing.assert_array_equal(np.isnan(found.measured), ~data["valid"].values)
    seen = data["valid"].values
    np.testing.assert_array_equal(found.measured[seen], data["measured_height"].values[seen].astype(np.float64))
    assert found.area is None


def test_surfaces_count_where_nothing_was_scanned() -> None:
    run = result(2, measured_height=None, area=np.ones((2, 4, 3)))
    found = record_of(run, "it")
    np.testing.assert_array_equal(found.measured, run.dataset["height"].values)
    np.testing.assert_array_equal(found.area, 1.0)


@pytest.mark.parametrize(
    ("layers", "maps", "message"),
    [
        (1, {}, "of 0 layers; needs pattern and measured_height of at least one layer"),
        (3, {"pattern": None}, "it: holds measured_height, valid, height of 2 layers; needs pattern"),
        (3, {"measured_height": None, "height": None}, "it: holds pattern, valid of 2 layers; needs"),
    ],
)
def test_run_that_tells_nothing_is_refused(layers: int, maps: dict[str, None], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        record_of(result(layers, **maps), "it")
    record_of(result(2), "it")
