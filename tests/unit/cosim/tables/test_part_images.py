"""Slices and height maps as parts: where each pixel lands, and what is refused."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from inkloop.errors import ScenarioError
from inkloop.exchange.layers import bitmap
from inkloop.metrology import map_writing
from inkloop.metrology.height_map import HeightMap
from inkloop.units import M_PER_UM
from support.parts import NX, NY, PITCH_UM, with_part

F = np.array([[1, 1, 1, 1], [1, 0, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], np.uint8)
"""The letter as a picture shows it: the first row is at the top."""
STACK = 'shape = "stack"\nlayer_um = 8.0\npixel_um = 100.0\nfiles = "{files}"\n'
BITS = STACK.format(files="s_{n:03d}.png")


def write_stack(folder: Path, *slices: np.ndarray, first: int = 1) -> None:
    for number, each in enumerate(slices, start=first):
        Image.fromarray(each).save(folder / f"s_{number:03d}.png")


def on_grid(letter: np.ndarray) -> np.ndarray:
    """The letter upright, x to the right and y up, in the middle of the grid."""
    expected = np.zeros((NX, NY), bool)
    expected[5:9, 3:9] = letter.T[:, ::-1]
    return expected


def errors_of(part: str, folder: Path) -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as caught:
        with_part(part, folder)
    return caught.value.errors


@pytest.mark.parametrize(
    ("stored", "keys"),
    [
        (F, 'mirror = "y"'),
        (F[::-1], ""),
        (F[::-1, ::-1], 'mirror = "x"'),
        (np.ascontiguousarray(F[::-1].T), 'rows_along = "y"'),
    ],
)
def test_letter_stands_upright(stored: np.ndarray, keys: str, tmp_path: Path) -> None:
    write_stack(tmp_path, *[stored] * 3)
    job = with_part(BITS + keys, tmp_path).job()
    np.testing.assert_array_equal(job.mask, on_grid(F))
    np.testing.assert_allclose(job.target_height[job.mask], 24e-6, rtol=1e-12)
    assert len(job.inks) == 1
    assert job.region is None


def test_formats_and_kinds_of_picture_give_the_same_part(tmp_path: Path) -> None:
    bits, pages = Image.fromarray(F.astype(bool)), [Image.fromarray(F.astype(bool))] * 2
    bits.save(tmp_path / "pages.tif", compression="group4", save_all=True, append_images=pages)
    for number in range(3):
        bits.save(tmp_path / f"b_{number}.bmp")
        Image.fromarray(np.repeat(F[..., None], 3, axis=2) * 255).save(tmp_path / f"rgb_{number}.png")
        (tmp_path / f"head_{number}.tif").write_bytes(bitmap.encode(F.T == 1, 1e-4, "tiff", "F"))  # 0 is white
    for files, full in (("pages.tif", 1), ("b_{n}.bmp", 1), ("rgb_{n}.png", 255), ("head_{n}.tif", 1)):
        part = STACK.format(files=files) + f'mirror = "y"\ninks = {{ 0 = "none", {full} = "A" }}'
        job = with_part(part, tmp_path).job()
        np.testing.assert_array_equal(job.mask, on_grid(F), err_msg=files)
        assert job.target_height.max() == pytest.approx(24e-6, rel=1e-12, abs=0.0)


def test_cell_takes_the_pixel_of_its_centre(tmp_path: Path) -> None:
    """Three pixels for two cells: centres of cells are at 0.25, 0.75 of three pixels' 1/6, 3/6, 5/6."""
    write_stack(tmp_path, np.arange(1, 10, dtype=np.uint8).reshape(1, 9).repeat(9, axis=0))
    greys = ", ".join(f'{grey} = "{"A" if grey % 2 else "none"}"' for grey in range(1, 10))
    pixel = 2 / 3 * PITCH_UM
    part = BITS.replace("pixel_um = 100.0", f"pixel_um = {pixel}") + f"inks = {{ {greys} }}"
    mask = with_part(part, tmp_path).job().mask
    x = (np.arange(NX) - (NX - 1) / 2) * PITCH_UM
    nearest = np.argmin(np.abs(x[:, None] - (np.arange(9) - 4) * pixel), axis=1)
    inside = np.abs(x) < 4.5 * pixel
    np.testing.assert_array_equal(mask[:, NY // 2], inside & ((nearest + 1) % 2 == 1))


def test_two_inks_of_a_stack_make_a_region_without_a_gap(tmp_path: Path) -> None:
    write_stack(tmp_path, F + 1, F + 1, np.where(F, 1, 2).astype(np.uint8))
    scenario = with_part(BITS + 'mirror = "y"', tmp_path)
    job = scenario.job()
    assert job.mask.sum() == F.size
    assert len(job.inks) == 2
    assert job.region is not None
    x, y = (axis[5:9, 3:9] * PITCH_UM * M_PER_UM for axis in np.meshgrid(range(NX), range(NY), indexing="ij"))
    letter = on_grid(F)[5:9, 3:9]
    for z, in_a in ((0.0, ~letter), (15.999e-6, ~letter), (16e-6, letter), (23.999e-6, letter)):
        np.testing.assert_array_equal(job.region.contains(x, y, np.full_like(x, z)), in_a)


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (BITS.replace("s_", "t_"), "part.files is 't_{n:03d}.png': no file in "),
        (BITS.replace("s_", "absent/s_"), "part.files: "),
        (BITS.replace("{n:03d}", "{layer}"), "part.files is 's_{layer}.png' ({layer} is none of {n})"),
        (STACK.format(files="text.png"), "part.files: "),
        (STACK.format(files="cut.png"), "part.files: "),
        (STACK.format(files="packed.tif"), "part.files: "),
        (STACK.format(files="red.png"), "part.files: "),
        (STACK.format(files="lossy.jpg"), "part.files: "),
        (STACK.format(files="deep.tif"), "part.files: "),
        (STACK.format(files="deep.png"), "part.files: "),
        (BITS.replace("pixel_um = 100.0", "pixel_um = 300.0"), "part reaches beyond the grid of 14 x 12 cells"),
        (BITS + 'inks = { 0 = "clear", 1 = "A" }', "part.inks.0 is 'clear'; expected 'none', 'A' or 'B'"),
    ],
)
def test_bad_stack_is_refused_by_name(part: str, expected: str, tmp_path: Path) -> None:
    write_stack(tmp_path, F, F)
    (tmp_path / "text.png").write_text("no picture")
    whole = (tmp_path / "s_001.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    Image.fromarray(F).save(tmp_path / "packed.tif", save_all=True, append_images=[Image.fromarray(F)])
    compression, unknown = (struct.pack("<HHIHH", 259, 3, 1, value, 0) for value in (1, 257))  # of its second page
    begin, _, end = (tmp_path / "packed.tif").read_bytes().rpartition(compression)
    (tmp_path / "packed.tif").write_bytes(begin + unknown + end)
    Image.fromarray(np.array([[[9, 0, 0]]], np.uint8)).save(tmp_path / "red.png")
    Image.fromarray(F).save(tmp_path / "lossy.jpg")
    deep = np.repeat(F[..., None], 3, axis=2).astype(np.uint16)  # Pillow drops the lower 8 bits of colours
    (tmp_path / "deep.png").write_bytes(imagecodecs.png_encode(deep))
    tifffile.imwrite(tmp_path / "deep.tif", np.moveaxis(deep, -1, 0), photometric="rgb", planarconfig="separate")
    (error,) = errors_of(part, tmp_path)
    assert error.startswith(expected)
    for file, reason in {
        "lossy.jpg": "is no picture that can be read; expected PNG, BMP, or TIFF",
        "deep": "has colours of 16 bits",
        "text.png": "is no picture",
        "cut.png": "is damaged",
        "packed.tif": "is damaged",
        "red.png": "has colours",
        "absent": "No such file",
    }.items():
        assert reason in error or file not in part


def test_slices_of_unequal_size_are_refused(tmp_path: Path) -> None:
    write_stack(tmp_path, F, F[:, :3])
    (error,) = errors_of(BITS, tmp_path)
    assert "s_002.png has 3 x 6 pixels along x and y, s_001.png has 4 x 6; save all slices in one size" in error
    write_stack(tmp_path, F, F, first=4)
    (error,) = errors_of(BITS, tmp_path)
    assert error.startswith("part.files is 's_{n:03d}.png': 1 of the slices 1 to 5 are missing: 3; add them")


def test_slices_may_begin_with_any_number(tmp_path: Path) -> None:
    write_stack(tmp_path, F, F, first=4)
    np.testing.assert_allclose(with_part(BITS, tmp_path).job().target_height.max(), 16e-6, rtol=1e-12)


def test_picture_that_says_it_is_larger_than_its_data_is_refused(tmp_path: Path) -> None:
    """Pillow takes memory for all of it, and leaves what no strip holds 0."""
    Image.fromarray(F).save(tmp_path / "s_001.tif")
    assert with_part(STACK.format(files="s_001.tif"), tmp_path).solid.remarks == ()
    rows, more = (struct.pack("<HHII", 257, 4, 1, count) for count in (len(F), 8_000_000))
    content = (tmp_path / "s_001.tif").read_bytes()
    assert content.count(rows) == 1
    (tmp_path / "s_001.tif").write_bytes(content.replace(rows, more))
    (error,) = errors_of(STACK.format(files="s_001.tif"), tmp_path)
    assert "s_001.tif: is damaged (it holds 24 of its 32,000,000 pixels); save it again" in error


def test_pictures_larger_than_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_stack(tmp_path, F)
    monkeypatch.setattr("inkloop.metrology.picture_file.memory_error", lambda needed: f"needs about {needed} bytes")
    (error,) = errors_of(BITS, tmp_path)
    assert "s_001.png: 4 x 6 pixels: needs about 192 bytes" in error


HEIGHTS = 'shape = "height-map"\nfile = "map.npy"\nunit = "um"\n'


@pytest.mark.parametrize(("pixel_um", "turn"), [(50.0, 0.0), (100.0, 90.0), (150.0, 0.0), (200.0, 0.0)])
def test_volume_under_a_height_map_is_kept(pixel_um: float, turn: float, tmp_path: Path) -> None:
    heights = np.random.default_rng(5).uniform(5.0, 60.0, (4, 4))
    np.save(tmp_path / "map.npy", heights)
    part = HEIGHTS + f"pixel_um = {pixel_um}\nrotation_deg = {turn}"
    job = with_part(part, tmp_path).job()
    expected = heights.sum() * pixel_um**2
    assert job.target_height.sum() / M_PER_UM * PITCH_UM**2 == pytest.approx(expected, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("cells", [(1, 4), (4, 1)])
def test_every_cell_below_an_oblong_pixel_has_its_height(cells: tuple[int, int], tmp_path: Path) -> None:
    """2 x 2 pixels, a cell wide and four long."""
    heights = np.array([[10.0, 20.0], [30.0, 40.0]]) * M_PER_UM
    dx, dy = (count * PITCH_UM * M_PER_UM for count in cells)
    map_writing.write(tmp_path / "map.sdf", HeightMap(heights, dx, dy), "sdf")
    scenario = with_part('shape = "height-map"\nfile = "map.sdf"', tmp_path)
    assert scenario.solid.volume == pytest.approx(heights.sum() * dx * dy, rel=1e-9, abs=0.0)
    target = scenario.job().target_height
    i, j = (slice(size // 2 - count, size // 2 + count) for size, count in zip((NX, NY), cells, strict=True))
    box = [PITCH_UM * (end - 0.5) for each in (i, j) for end in (each.start, each.stop)]
    assert [value / M_PER_UM for value in scenario.solid.bounds] == pytest.approx(box, rel=1e-9, abs=0.0)
    np.testing.assert_allclose(target[i, j], heights.repeat(cells[0], axis=0).repeat(cells[1], axis=1), rtol=1e-9)
    assert np.count_nonzero(target) == 4 * 4


@pytest.mark.parametrize(("least", "printed"), [(None, 2), (0.5, 2), (0.51, 1), (0.25, 3), (0.8, 0)])
def test_cell_is_printed_where_enough_of_its_pixels_have_a_height(
    least: float | None, printed: int, tmp_path: Path
) -> None:
    """Of four pixels each: one, two and three."""
    heights = np.full((2, 6), 20.0)
    heights[0, :4] = heights[1, 1] = heights[1, 5] = np.nan
    np.save(tmp_path / "map.npy", heights.T)
    key = "" if least is None else f"\nvalid_share_min = {least}"
    part = f"{HEIGHTS}pixel_um = 50.0\ncenter_x_um = 600.0{key}"
    if not printed:
        assert "part covers no cell of the grid" in errors_of(part, tmp_path)[0]
        return
    assert with_part(part, tmp_path, nx=12, ny=11).job().mask.sum() == printed


def test_pixels_without_a_height_and_heights_below_the_substrate_are_not_printed(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", np.array([[10.0, np.nan, -3.0], [20.0, 0.0, 5.0]]))
    scenario = with_part(HEIGHTS + "pixel_um = 200.0\nbase_um = 2.0", tmp_path, nx=14, ny=14)
    job = scenario.job()
    assert scenario.solid.volume == pytest.approx((12 + 22 + 2 + 7) * 200**2 * M_PER_UM**3, rel=1e-9, abs=0.0)
    expected = np.array([[12.0, 0.0, 0.0], [22.0, 2.0, 7.0]]).repeat(2, axis=0).repeat(2, axis=1)
    np.testing.assert_allclose(job.target_height[5:9, 4:10], expected * M_PER_UM, atol=1e-15)
    np.testing.assert_array_equal(job.mask[5:9, 4:10], expected > 0.0)
    assert job.mask.sum() == 4 * 4


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (HEIGHTS + "pixel_um = 900.0", "part reaches beyond the grid of 14 x 12 cells: it is 1800 x 1800 µm wide"),
        (HEIGHTS, "does not declare the size of its pixels"),
        (HEIGHTS.replace("map.npy", "absent.csv"), "absent.csv: cannot be read: No such file"),
        (HEIGHTS.replace('"um"', '"inch"'), "part.unit is 'inch'; expected 'nm', 'um', 'mm' or 'm'"),
        (HEIGHTS + "pixel_um = 100.0\nbase_um = -99.0", "part covers no cell of the grid"),
    ],
)
def test_bad_height_map_is_refused_by_name(part: str, expected: str, tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", np.ones((2, 2)))
    (error,) = errors_of(part, tmp_path)
    assert error.startswith("part")
    assert expected in error


@pytest.mark.parametrize(("page", "place"), [(0, "all.tif"), (1, "all.tif, page 2"), (2, "all.tif, page 3")])
def test_unknown_grey_value_is_named_with_page_row_and_column(page: int, place: str, tmp_path: Path) -> None:
    pages = np.array([F] * 3)
    pages[page, 2, 3] = pages[page, 4, 0] = 7
    tifffile.imwrite(tmp_path / "all.tif", pages, photometric="minisblack")
    (error,) = errors_of(STACK.format(files="all.tif"), tmp_path)
    assert f"inks has no grey value 7, which {place} has first in row 2, column 3; 2 pixels of it have" in error
    assert "known are 0, 1, 2" in error


def bounds_um(part: str, folder: Path) -> list[float]:
    return [value / M_PER_UM for value in with_part(part, folder).solid.bounds]


@pytest.mark.parametrize(
    ("keys", "on_grid"),
    [
        ("", lambda z: z),
        ("rotation_deg = 90.0", lambda z: z.T[::-1]),
        ("rotation_deg = 180.0", lambda z: z[::-1, ::-1]),
        ("rotation_deg = 270.0", lambda z: z.T[:, ::-1]),
        ('mirror = "x"', lambda z: z[::-1]),
        ('mirror = "y"', lambda z: z[:, ::-1]),
        ('rows_along = "y"', lambda z: z),
        ('mirror = "x"\nrotation_deg = 90.0', lambda z: z[::-1].T[::-1]),
    ],
)
def test_oblong_height_map_is_turned_and_stands_around_its_centre(
    keys: str, on_grid: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    """3 x 5 pixels of a cell each around the cell (5, 4), heights from 3 um on, turned counterclockwise."""
    heights = np.arange(4.0, 19.0).reshape(3, 5)
    np.save(tmp_path / "map.npy", heights)
    part = f"{HEIGHTS}pixel_um = 100.0\nbase_um = -1.0\ncenter_x_um = 500.0\ncenter_y_um = 400.0\n{keys}"
    turned = on_grid(heights - 1.0)
    expected = np.zeros((NX, NY))
    nx, ny = turned.shape
    expected[5 - nx // 2 : 6 + nx // 2, 4 - ny // 2 : 5 + ny // 2] = turned
    np.testing.assert_allclose(with_part(part, tmp_path).job().target_height / M_PER_UM, expected, atol=1e-9)
    box = [500 - 50 * nx, 500 + 50 * nx, 400 - 50 * ny, 400 + 50 * ny]
    assert bounds_um(part, tmp_path) == pytest.approx(box, rel=1e-12, abs=0.0)


def test_box_of_a_height_map_leaves_out_what_is_not_printed(tmp_path: Path) -> None:
    """Only pixels (1, 2) and (1, 3) of 3 x 5 are above the substrate, with 2 um taken off all."""
    heights = np.full((3, 5), 2.0)
    heights[1, 2:4] = 9.0
    np.save(tmp_path / "map.npy", heights)
    part = f"{HEIGHTS}pixel_um = 100.0\nbase_um = -2.0\ncenter_x_um = 500.0\ncenter_y_um = 400.0"
    assert bounds_um(part, tmp_path) == pytest.approx([450.0, 550.0, 350.0, 550.0], rel=1e-12, abs=0.0)


@pytest.mark.parametrize(("rows_along", "stored"), [("x", lambda z: z.T), ("y", lambda z: z)])
def test_counts_of_a_picture_are_heights_by_their_scale(
    rows_along: str, stored: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    counts = np.arange(20, 35, dtype=np.uint16).reshape(3, 5)
    counts[1, 3] = 9
    Image.fromarray(np.ascontiguousarray(stored(counts))).save(tmp_path / "map.png")
    part = (
        'shape = "height-map"\nfile = "map.png"\nunit = "nm"\ncount_scale = 500.0\npixel_um = 100.0\n'
        "invalid_value = 9.0\n"
        f'rows_along = "{rows_along}"\ncenter_x_um = 500.0\ncenter_y_um = 400.0'
    )
    expected = counts * 0.5
    expected[1, 3] = 0.0
    found = with_part(part, tmp_path).job().target_height / M_PER_UM
    np.testing.assert_allclose(found[4:7, 2:7], expected, rtol=1e-9)
    assert found.sum() == pytest.approx(expected.sum(), rel=1e-9, abs=0.0)
