"""Headers, keys and bounds of maps one by one: their meaning, and the exact limits."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from inkloop.component import Ink, Job
from inkloop.errors import ComponentError, HeightMapError
from inkloop.metrology import map_folder
from inkloop.metrology.datum import level, plane, reference_cells
from inkloop.metrology.evaluation.definitions import Treatment
from inkloop.metrology.evaluation.surface import Refusal, Surface, evaluated, s_filtered
from inkloop.metrology.folder_watch import FolderWatch, name_errors, numbered_files
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.placement import Placement
from inkloop.metrology.registration import Registration, from_fiducials
from inkloop.metrology.table_file import read_header
from support.evaluated import map_of

UM = 1e-6


@pytest.mark.parametrize(
    ("lines", "unit", "pixel_um"),
    [
        (["pixel size = 5 um", "height unit = nm"], "nm", (5.0, 5.0)),
        (["pixel_um, 5", "z_mm"], "mm", (5.0, 5.0)),
        (["x step; 2 um", "y step; 3 um"], None, (2.0, 3.0)),
        (["pixel size x [mm] = 0.002", "pixel size y [mm] = 0.003", "Topography [nm]"], "nm", (2.0, 3.0)),
        (["spacing = 4 um", "dy = 6 um"], None, (4.0, 6.0)),
        (["width = 80 um", "height = 30 um"], None, (8.0, 6.0)),  # of 10 columns and 5 rows
        (["field height = 30 um"], None, None),  # along x nothing is known
        (["dx = 2 um"], None, None),
        (["dx = 2", "dy = 3"], None, None),  # no unit, no length
        (["gain = 5 um", "units: m"], "m", None),
    ],
)
def test_header_states_unit_and_pixel(lines: list[str], unit: str | None, pixel_um: Any) -> None:
    found, pixel = read_header(lines, columns=10, rows=5)
    assert found == unit
    assert (pixel and [size / UM for size in pixel]) == (pixel_um and pytest.approx(list(pixel_um), rel=1e-9, abs=0.0))


Z = np.arange(6.0).reshape(3, 2)


@pytest.mark.parametrize(
    ("arrays", "options", "height_um", "pixel_um"),
    [
        ({"height_mm": Z, "pixel_um": 5.0}, {}, 5000.0, (5.0, 5.0)),
        ({"z": Z, "dx_um": 2.0, "dy_nm": 3000.0}, {"unit": "um"}, 5.0, (2.0, 3.0)),
        ({"anything": Z, "other": np.ones(4)}, {"unit": "nm", "pixel": 1e-6}, 5e-3, (1.0, 1.0)),
        ({"height_um": Z, "mask": np.ones((3, 2)), "pixel_mm": 0.004}, {}, 5.0, (4.0, 4.0)),
        ({"z_um": Z, "pixel_um": 5.0, "dy_um": 7.0}, {}, 5.0, (5.0, 7.0)),
    ],
)
def test_arrays_are_named_with_their_units(
    arrays: Any, options: Any, height_um: float, pixel_um: tuple[float, float], tmp_path: Path
) -> None:
    np.savez(tmp_path / "map.npz", **arrays)
    found = read(tmp_path / "map.npz", **options)
    assert found.z[2, 1] == pytest.approx(height_um * UM, rel=1e-9, abs=0.0)
    assert (found.dx / UM, found.dy / UM) == pytest.approx(pixel_um, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"a": Z, "b": Z}, r"holds a \(3, 2\), b \(3, 2\); expected one map, named z_um, height_um or z"),
        ({"a": np.ones(3)}, r"holds a \(3,\); expected one map"),
        ({"z_um": Z, "height_um": Z}, "expected one map"),
        ({}, "holds nothing; expected one map"),
    ],
)
def test_arrays_without_one_map_are_listed(arrays: Any, message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(HeightMapError, match=message):
        read(tmp_path / "map.npz", unit="um", pixel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pixel": 5.2e-6}, "declares pixels of 5 x 5 µm, but pixel_um is 5.2; leave it out"),
        ({"pixel": 5.04e-6}, ""),  # files round
        ({"pixel": (5e-6, 6e-6)}, "declares pixels of 5 x 5 µm, but pixel_um is 5 x 6"),
        ({"unit": "nm"}, "declares heights in um, but unit is 'nm'"),
        ({"unit": "um"}, ""),
        ({"unit": "inch"}, "unit is 'inch'; expected one of nm, um, mm, m"),
        ({"pixel": 0.0}, "pixel_um is 0; expected lengths above 0"),
        ({"scale": 0.0}, "count_scale is 0.0; expected a height per count above 0"),
    ],
)
def test_option_may_not_contradict_the_file(options: Any, message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", z_um=Z, pixel_um=5.0)
    if not message:
        assert read(tmp_path / "map.npz", **options).dx == pytest.approx(5e-6, rel=1e-12, abs=0.0)
        return
    with pytest.raises(HeightMapError, match=message):
        read(tmp_path / "map.npz", **options)


def test_pixels_of_tiff_are_those_of_its_tags(tmp_path: Path) -> None:
    heights, path = np.ones((2, 3), np.float32), tmp_path / "map.tif"

    def pixel(**options: Any) -> tuple[float, float]:
        tifffile.imwrite(path, heights, **options)
        found = read(path, unit="um")
        return round(found.dx / UM, 6), round(found.dy / UM, 6)

    assert pixel(resolution=(1000, 500), resolutionunit="CENTIMETER") == (10.0, 20.0)
    assert pixel(imagej=True, resolution=(0.5, 0.25), metadata={"unit": "um"}) == (2.0, 4.0)
    assert pixel(ome=True, metadata={"axes": "YX", "PhysicalSizeX": 3.0, "PhysicalSizeY": 6.0}) == (3.0, 6.0)
    for options in (
        {"ome": True, "metadata": {"axes": "YX", "PhysicalSizeX": 3.0}},
        {"imagej": True, "resolution": (0.5, 0.25), "metadata": {"unit": "furlong"}},
        {"resolution": (300, 300), "resolutionunit": "INCH"},
        {"resolution": (300, 300), "resolutionunit": "NONE"},
    ):
        with pytest.raises(HeightMapError, match="does not declare the size of its pixels"):
            pixel(**options)


def test_map_of_no_height_or_no_size_is_none() -> None:
    found = HeightMap(np.array([[1.0, np.inf], [-np.inf, 2.0]]), 1e-6, 2e-6)
    assert found.valid.tolist() == [[True, False], [False, True]]
    assert found.shape == (2, 2)
    for dx, dy in ((0.0, 1.0), (1.0, -1.0), (np.inf, 1.0), (1.0, np.nan)):
        with pytest.raises(HeightMapError, match=r"height map: the pixel size d[xy] is .* m; needs a length above 0"):
            HeightMap(Z, dx, dy)


def test_files_have_the_number_of_their_layer(tmp_path: Path) -> None:
    for name in (
        "scan_0007_b2.csv",
        "scan_0012_b2.csv",
        "scan_12_b2.csv",
        "scan_0007_b3.csv",
        "x_0001_b2.csv",
        "a.txt",
    ):
        (tmp_path / name).touch()
    found = numbered_files(tmp_path, "scan_{layer:04d}_b2.csv", "layer")
    assert {number: path.name for number, path in found.items()} == {7: "scan_0007_b2.csv", 12: "scan_0012_b2.csv"}
    assert name_errors("file_name", "a{layer}.csv", "layer", "b") == []
    for template in ("a.csv", "../{layer}.csv", "{layer:.0f}/x.csv"):
        (error,) = name_errors("file_name", template, "layer", "b")
        assert "expected a name of its own for each layer, such as 'b'" in error


JOB = Job(10, 8, 250e-6, np.zeros((10, 8)), np.zeros((10, 8), np.bool_), (Ink(),))
JOB.mask[3:7, 2:6] = True
JOB.target_height[JOB.mask] = 3 * JOB.inks[0].layer_height


def fine(heights: Any) -> HeightMap:
    """Cells as 5 x 5 pixels each."""
    return HeightMap(np.kron(heights, np.ones((5, 5))), 50e-6, 50e-6, source="scan.csv")


AT_HOME = Registration(-100e-6, -100e-6)
"""Place of the first pixel of `fine`."""


def test_placed_map_says_how_much_of_the_part_it_shows() -> None:
    heights = np.arange(80.0).reshape(10, 8) * UM
    heights[3, 2:4] = np.nan
    found = Placement(JOB, AT_HOME).place(fine(heights), 1)
    np.testing.assert_allclose(found.height, heights, rtol=1e-9)
    assert np.argwhere(~found.valid).tolist() == [[3, 2], [3, 3]]
    assert found.words == "88% of the part measured"
    heights[4:6] = np.nan
    with pytest.raises(HeightMapError, match=r"scan\.csv: 38% of the part's cells were measured; needs 50%"):
        Placement(JOB, AT_HOME).place(fine(heights), 1)
    heights[4, 2:4] = 1.0
    assert Placement(JOB, AT_HOME).place(fine(heights), 1).words == "50% of the part measured"
    with pytest.raises(HeightMapError, match="no pixel of it was measured; scan again"):
        Placement(JOB, AT_HOME).place(fine(heights * np.nan), 1)


def test_cell_counts_from_the_share_that_is_asked_for() -> None:
    z = np.zeros((50, 40))
    z[0, :], z[5:8, :] = np.nan, np.nan  # a fifth of the first row of cells, three fifths of the second
    fine_map = HeightMap(z, 50e-6, 50e-6)
    found = Placement(JOB, AT_HOME, share_min=0.5).place(fine_map, 1)
    assert found.valid.all(axis=1).tolist() == [True, False] + [True] * 8
    found = Placement(JOB, AT_HOME, share_min=0.39).place(fine_map, 1)
    assert found.valid.all()


def test_advice_names_the_places_of_map_and_grid() -> None:
    away = Registration(10e-3, 20e-3)
    with pytest.raises(HeightMapError) as raised:
        Placement(JOB, away).place(replace(fine(np.ones((10, 8))), x0=1e-3, y0=2e-3), 0)
    message = str(raised.value)
    assert "0% of the part's cells were measured; needs 50%" in message
    assert "Its field lies at x 11.00 to 13.50, y 22.00 to 24.00 mm, the grid at 0 to 2.50 and 0 to 2.00 mm" in message
    assert "100% of its pixels hold a height" in message


def test_map_is_fitted_to_the_layers_that_are_printed() -> None:
    layer = JOB.inks[0].layer_height
    shifted = replace(AT_HOME, offset_x=AT_HOME.offset_x + 100e-6, offset_y=AT_HOME.offset_y - 50e-6)
    placement = Placement(JOB, shifted, fit_reach=(300e-6, 0.0))
    printed = np.where(JOB.mask, 2 * layer, 0.0)
    found = placement.place(fine(printed), 2)
    np.testing.assert_allclose(found.height[JOB.mask], 2 * layer, atol=0.02 * layer)
    assert found.words.startswith("100% of the part measured, fitted to ")
    assert found.words.endswith("100% of its relief is the part's")
    flat = placement.place(fine(np.ones((10, 8)) * UM), 0)  # of the start surface nothing can be fitted
    assert "fitted" not in flat.words


def test_datum_is_the_median_or_the_plane_of_what_lies_around_the_part() -> None:
    i, j = np.indices((10, 8))
    ground = 3.0 + 0.25 * i - 0.5 * j
    reference = reference_cells(JOB.mask, 1)
    assert not reference[2:8, 1:7].any()
    assert reference.sum() == 80 - 36
    assert reference_cells(JOB.mask, 0).sum() == 80 - 16
    height = (ground + 20.0 * JOB.mask) * UM
    height[0, 0] += 50e-6  # dirt
    np.testing.assert_allclose(level(height, reference, "plane")[JOB.mask], 20e-6, rtol=1e-9)
    assert not plane(height, reference)[1][0, 0]
    np.testing.assert_array_equal(level(height, reference, "none"), height)
    offset = level(height, reference, "offset")
    np.testing.assert_allclose(height - offset, np.median(height[reference]), rtol=1e-9)
    few = np.zeros(reference.shape, np.bool_)
    few[0, :7] = True
    with pytest.raises(HeightMapError, match="7 cells outside the part were measured, the plane needs 8"):
        level(height, few, "plane")
    few[0, 7] = True
    with pytest.raises(HeightMapError, match="lie on one line and define no plane"):
        level(height, few, "plane")
    with pytest.raises(HeightMapError, match="0 cells outside the part were measured, the offset needs 1"):
        level(height, few & False, "offset")


@pytest.mark.parametrize(("swap", "other"), [("none", "y"), ("y", "none"), ("x", "none")])
def test_fiducials_of_a_mirrored_map_are_recognised(swap: Any, other: str) -> None:
    on_map = np.array([[0.0, 0.0], [3e-3, 0.0], [0.0, 1e-3]])
    truth = Registration(1e-3, 2e-3, 0.4, mirror=other)  # type: ignore[arg-type]
    on_grid = np.stack(truth.to_grid(on_map[:, 0], on_map[:, 1]), axis=1)
    with pytest.raises(HeightMapError, match=f"with mirror = '{other}' it is .* µm: the map is mirrored"):
        from_fiducials(on_map, on_grid, mirror=swap, residual_max=1e-6)
    for points in (on_map[:1], on_map[:, :1], np.zeros((3, 2)), on_map * np.nan):
        with pytest.raises(HeightMapError, match="fiducials: "):
            from_fiducials(points, on_grid[: len(points)], residual_max=1e-6)


def test_registration_turns_from_x_to_y_after_the_mirror() -> None:
    quarter = Registration(1.0, 2.0, math.pi / 2, scale=2.0, mirror="x")
    x, y = quarter.to_grid(np.array([3.0]), np.array([5.0]))  # mirrored (-3, 5), turned (-5, -3), twice as far
    assert (float(x[0]), float(y[0])) == pytest.approx((1.0 - 10.0, 2.0 - 6.0), rel=1e-12, abs=0.0)


def test_surface_needs_fifty_cells_and_four_fifths_of_them() -> None:
    z = np.random.default_rng(1).normal(size=(7, 10)) * UM
    mask = np.zeros(z.shape, np.bool_)
    mask[:5] = True
    assert isinstance(evaluated(map_of(z), mask), Surface)
    mask[0, 0] = False
    few = evaluated(map_of(z), mask)
    assert isinstance(few, Refusal)
    assert few.reason == "49 cells have a height; needs 50: take a larger mask or map"
    z[0] = np.nan
    z[1, :4] = np.nan  # 14 of 70 are a fifth
    assert isinstance(evaluated(map_of(z)), Surface)
    z[1, 4] = np.nan
    lacking = evaluated(map_of(z))
    assert isinstance(lacking, Refusal)
    assert lacking.reason.startswith("15 of 70 cells have no height; at most 20% may lack one")


def test_treatment_is_told_for_each_group() -> None:
    plain, both = Treatment(), Treatment("form", 2.5e-6, 8e-5, 0)
    assert str(plain) == "taken off: least-squares plane; no filter"
    assert "S-filter 2.5 µm, L-filter 80 µm (Gaussian, regression order 0)" in str(both)
    assert both.of("areal") == str(both) != str(plain)
    assert both.of("form") == "nothing taken off; S-filter 2.5 µm (Gaussian, regression order 0)"
    assert both.of("volume") == "nothing taken off; no filter"
    assert plain.of("form") == "nothing taken off; no filter"


def test_s_filter_keeps_gaps_and_makes_no_edge_of_them() -> None:
    z = np.full((12, 12), 5e-6)
    z[4, 4] = np.nan
    found = s_filtered(map_of(z), Treatment(s_filter=5e-5))
    assert isinstance(found, HeightMap)
    assert np.argwhere(np.isnan(found.z)).tolist() == [[4, 4]]
    np.testing.assert_allclose(found.z[np.isfinite(found.z)], 5e-6, rtol=1e-9)
    assert found.source == "test"
    assert isinstance(s_filtered(map_of(z), Treatment(s_filter=1.0)), Refusal)
    same = map_of(z)
    assert s_filtered(same, Treatment()) is same


def profiler(folder: Path, **options: Any) -> Any:
    part = map_folder.MapFolder(JOB, folder=str(folder), file_name="{layer}.npz", **options)
    part.initialize(0, {})
    return part


def write(folder: Path, layer: int, um: float) -> None:
    np.savez(folder / f"{layer}.npz", z_um=np.kron(np.full((10, 8), um), np.ones((5, 5))), pixel_um=50.0)


def scanned(part: Any, layer: int) -> Any:
    return part.do_step(0, 1, {"layers_printed": np.asarray(layer, np.int32)})


def test_wait_is_told_after_two_seconds_and_then_every_half_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now = [0.0]

    class Watch(FolderWatch):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given, clock=lambda: now[0], sleep=lambda seconds: None)

    monkeypatch.setattr(map_folder, "FolderWatch", Watch)
    monkeypatch.setattr(map_folder, "PATIENCE_S", 0.0)
    caplog.set_level(logging.INFO)
    part = profiler(tmp_path, timeout_s=70.0)
    messages = []
    for now[0] in (0.0, 1.9, 2.0, 10.0, 31.9, 32.0, 33.0, 62.0, 70.0):
        before = len(caplog.records)
        scanned(part, 3)
        messages += [(now[0], record.getMessage()) for record in caplog.records[before:]]
    assert [time for time, _ in messages] == [2.0, 32.0, 62.0]
    path = tmp_path / "3.npz"
    assert messages[1][1] == f"layer 3 is printed: waiting for {path} since 32 s (up to 70 s)"
    now[0] = 70.1
    with pytest.raises(ComponentError, match=r"3\.npz did not come within 70 s"):
        scanned(part, 3)


def test_restored_folder_looks_for_leftovers_and_takes_no_other_field(tmp_path: Path) -> None:
    options: dict[str, Any] = {"complete": "renamed", "offset_x_um": -100.0, "offset_y_um": -100.0}
    part = profiler(tmp_path, **options)
    write(tmp_path, 0, 1.0)
    scanned(part, 0)
    other = profiler(tmp_path, **options)
    other.restore(part.save())
    write(tmp_path, 2, 3.0)
    with pytest.raises(ComponentError, match=r"2\.npz is there before layer 2 is printed"):
        scanned(other, 1)
    (tmp_path / "2.npz").unlink()
    np.savez(tmp_path / "1.npz", z_um=np.ones((40, 40)), pixel_um=50.0)
    other.restore(part.save())
    with pytest.raises(ComponentError, match="has 40 x 40 pixels, the scans before it 50 x 40; scan the same field"):
        scanned(other, 1)
    small = map_folder.MapFolder(
        Job(4, 4, 250e-6, np.zeros((4, 4)), np.ones((4, 4), np.bool_), (Ink(),)), folder=str(tmp_path)
    )
    with pytest.raises(ComponentError, match=r"has \(10, 8\) cells; this grid has \(4, 4\)"):
        small.restore(part.save())
