"""Prints logged by other programs: what is read, and what is refused with a message."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray

from inkloop.contract import pass_colours
from inkloop_lab.identify.log_folder import read_log
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, record_of
from inkloop_lab.models import LayerDeposition, VolumeAreaDeposition
from support.logged_print import CELL, PITCH, log, made_up, random_layers

INKED = "\ninked_um = 1.0\nmiddle_share = 0.3\n"
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


def test_level_is_that_of_cells_more_than_two_cells_away_from_droplets() -> None:
    """Droplets of some inks reach two cells far."""
    pattern, scan = np.zeros((1, 6, 6), np.int32), np.full((6, 6), 3e-6)
    pattern[0, 2, 2] = 1
    scan[:5, :5] = 4e-6
    levelled = PrintRecord("it", PITCH, pattern, np.stack([np.zeros((6, 6)), scan])).levelled("offset")
    np.testing.assert_allclose(levelled.measured[1], scan - 3e-6, atol=1e-15)


def test_covered_area_is_of_the_whole_cell_over_the_median_of_the_start(tmp_path: Path) -> None:
    """Of 4 x 4 pixels two are ink, one was not seen; a spike of the start surface is no ground."""
    record = made_up(LayerDeposition(), [np.zeros((6, 5), np.int32)])
    folder = log(tmp_path / "print", record, CELL.replace("pixel_um = 263.256", FINE) + INKED, 4)
    start, fine = np.zeros((24, 20)), np.zeros((24, 20))
    start[0, :3], fine[4:6, 8], fine[7, 11] = 90.0, 2.0, np.nan
    for layer, scan in enumerate((start + 30.0, fine + 30.0)):
        np.savetxt(folder / f"layer_{layer:04d}.csv", scan.T, fmt="%.9f", delimiter=",")
    read = read_log(folder)
    expected = np.zeros((6, 5))
    expected[1, 2] = 2.0 / 15.0
    assert read.area is not None
    np.testing.assert_allclose(read.area[1], expected, rtol=1e-9)
    assert read.area[0, 0, 0] == pytest.approx(3.0 / 16.0, rel=1e-9, abs=0.0)
    assert read_log(log(tmp_path / "none", record)).area is None


@pytest.mark.parametrize(("share", "is_known"), [("", True), ("valid_share_min = 0.6\n", False)])
def test_cell_counts_where_enough_of_its_pixels_were_measured(share: str, is_known: bool, tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), [np.eye(6, 5, dtype=np.int32)])
    folder = log(tmp_path / "print", record, CELL.replace("pixel_um = 263.256", FINE) + f"\n{share}", 4)
    fine = np.kron(record.measured[1] * 1e6, np.ones((4, 4)))
    fine[8:10, 4:8] = np.nan  # half of cell (2, 1)
    np.savetxt(folder / "layer_0001.csv", fine.T, fmt="%.9f", delimiter=",")
    assert np.isfinite(read_log(folder).measured[1, 2, 1]) == is_known


@pytest.mark.parametrize(("delimiter", "header"), [(";", ""), ("\t", ""), ("\t", "jetted, by row"), (" ", "")])
def test_patterns_are_read_with_any_separator(delimiter: str, header: str, tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(5, 4, 1, 0))
    folder = log(tmp_path / "print", record)
    np.savetxt(folder / "pattern_0001.csv", record.pattern[0].T, fmt="%d", delimiter=delimiter, header=header)
    np.testing.assert_array_equal(read_log(folder).pattern, record.pattern)


def test_arrays_have_x_along_their_first_index_and_tables_where_it_is_said(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(5, 4, 1, 0))
    names = 'patterns = "p{layer}.npy"\nmaps = "m{layer}.npy"\n'
    for folder, rows in ((tmp_path / "own", ""), (tmp_path / "turned", 'rows_along = "x"\n')):
        log(folder, record, CELL + names + rows)
        for name, maps in (("p1", record.pattern[0]), ("m0", record.measured[0]), ("m1", record.measured[1])):
            values = maps if name == "p1" else maps * 1e6
            np.save(folder / f"{name}.npy", values.T if rows else values)
        read = read_log(folder)
        np.testing.assert_array_equal(read.pattern, record.pattern)
        np.testing.assert_allclose(read.measured, record.measured, atol=1e-14)
    folder = log(tmp_path / "table", record, CELL + 'rows_along = "y"\n')
    np.savetxt(folder / "pattern_0001.csv", record.pattern[0], fmt="%d", delimiter=",")
    for layer, scan in enumerate(record.measured):
        np.savetxt(folder / f"layer_{layer:04d}.csv", scan * 1e6, delimiter=",")
    read = read_log(folder)
    np.testing.assert_array_equal(read.pattern, record.pattern)
    np.testing.assert_allclose(read.measured, record.measured, atol=1e-14)
    np.save(tmp_path / "own" / "p1.npy", np.ones((2, 3, 4)))
    with pytest.raises(IdentificationError, match=r"p1\.npy: holds an array of shape \(2, 3, 4\); expected rows"):
        read_log(tmp_path / "own")


def test_counts_have_their_scale_and_the_value_that_is_none(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(5, 4, 1, 0))
    folder = log(tmp_path / "print", record, CELL + "count_scale = 0.01\ninvalid_value = -999\n")
    for layer, scan in enumerate(record.measured):
        counts = np.round(scan * 1e8).T
        counts[2, 3] = -999
        np.savetxt(folder / f"layer_{layer:04d}.csv", counts, fmt="%d", delimiter=",")
    read = read_log(folder)
    expected = record.measured.copy()
    expected[:, 3, 2] = np.nan
    np.testing.assert_allclose(read.measured, expected, atol=0.6e-8)
    (folder / "layer_0001.csv").write_text("-999,-999\n" * 2)
    with pytest.raises(IdentificationError, match=r"layer_0001\.csv: no pixel of it was measured"):
        read_log(folder)


def test_passes_of_a_log_are_those_of_its_description(tmp_path: Path) -> None:
    record = made_up(LayerDeposition(), random_layers(5, 4, 2, 0))
    read = read_log(log(tmp_path / "print", record))
    assert (read.passes, read.pass_order, read.pass_rotation) == (1, 1, 0)
    process = 'passes = 4\npass_order = "diagonal"\npass_rotation = 3\n'
    read = read_log(log(tmp_path / "print", record, CELL + process))
    assert (read.passes, read.pass_order, read.pass_rotation) == (4, 2, 3)
    colours = [layer.colours for layer in read.layers()]
    assert colours == [pass_colours(4, 2, 3, number) for number in (1, 2)]
    assert colours[0] != colours[1]


def test_first_layers_of_a_print_have_their_scans_and_areas() -> None:
    record = made_up(VolumeAreaDeposition(), random_layers(6, 5, 4, 0))
    first = record.first(2)
    assert record.area is not None
    assert first.area is not None
    np.testing.assert_array_equal(first.pattern, record.pattern[:2])
    np.testing.assert_array_equal(first.measured, record.measured[:3])
    np.testing.assert_array_equal(first.area, record.area[:3])


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
    (folder / "pattern_0001.csv").write_text((folder / "pattern_0001.csv").read_text() * 2)
    (folder / "pattern_0002.csv").write_text("0,1\n" * 36)  # as many cells as the first one has
    with pytest.raises(
        IdentificationError, match=r"pattern_0002\.csv: has \(2, 36\) cells, the first pattern \(6, 12\)"
    ):
        read_log(folder)
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
        (CELL + "pass_rotation = 4\n", "pass_rotation is 4; expected less than or equal to 3"),
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
