"""Map files of other programs: read as those programs mean them, or refused with the reason and the way out."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from inkloop.errors import HeightMapError
from inkloop.metrology.map_file import read

UM = 1e-6
Z = np.array([[0.5, 1.5, -2.25], [3.0, 2.5, 4.125], [5.0, 6.5, 7.0], [8.0, 9.0, 1.0]])
"""(4, 3): four pixels along x, three along y, [um]."""
ROWS = "".join("\t".join(f"{z:g}" for z in row) + "\n" for row in Z.T)
GIVEN: dict[str, Any] = {"unit": "um", "pixel": 5 * UM}
GREY = np.array([[0, 100, 255], [100, 0, 255]], np.uint8)


@pytest.mark.parametrize(
    "header",
    [
        "# Kanal: H\u00f6he\n# Breite: 20 \u00b5m\n# H\u00f6he: 0,012 mm\n# Einheit: \u00b5m\n",
        "# \u30c1\u30e3\u30cd\u30eb\uff1a Z\n# \u5e45\uff1a 20 \u00b5m\n# \u9ad8\u3055\uff1a 12 \u00b5m\n"
        "# \u5358\u4f4d\uff1a \u00b5m\n",
        "# Channel: Height\n# Width: 20 \u00b5m\n# Height: 12 \u00b5m\n# Value units: \u00b5m\n",
    ],
    ids=["German", "Japanese", "English"],
)
def test_gwyddion_text_is_read_in_any_language(header: str, tmp_path: Path) -> None:
    (tmp_path / "map.txt").write_text(header + ROWS, encoding="utf-8")
    found = read(tmp_path / "map.txt")
    np.testing.assert_allclose(found.z, Z * UM, rtol=1e-12)
    assert (found.dx, found.dy) == pytest.approx((5 * UM, 4 * UM), rel=1e-12, abs=0.0)


@pytest.mark.parametrize("key", ["NODATA_value", "nodata", "# No data value:", "Missing value ="])
def test_number_that_a_table_declares_as_no_data_is_none(key: str, tmp_path: Path) -> None:
    table = "ncols 4\nnrows 3\ncellsize 5\n" + f"{key} -9999\n" + ROWS.replace("2.5", "-9999.000")
    (tmp_path / "map.asc").write_text(table)
    np.testing.assert_allclose(read(tmp_path / "map.asc", **GIVEN).z, np.where(Z == 2.5, np.nan, Z) * UM, rtol=1e-12)
    (tmp_path / "map.asc").write_text(table.replace("nrows 3", "nrows 4"))
    with pytest.raises(HeightMapError, match=r"has 3 rows of 4 heights, its header states 16 heights; it may be cut"):
        read(tmp_path / "map.asc", **GIVEN)


def test_number_that_gdal_declares_as_no_data_is_none(tmp_path: Path) -> None:
    heights = np.where(Z.T == 2.5, -3.4028234663852886e38, Z.T).astype(np.float32)
    tifffile.imwrite(tmp_path / "map.tif", heights, extratags=[(42113, 2, 0, "-3.4028234663852886e+38", True)])
    np.testing.assert_allclose(read(tmp_path / "map.tif", **GIVEN).z, np.where(Z == 2.5, np.nan, Z) * UM, rtol=1e-6)
    both = read(tmp_path / "map.tif", invalid_value=9.0, **GIVEN).z
    np.testing.assert_allclose(both, np.where((Z == 2.5) | (Z == 9.0), np.nan, Z) * UM, rtol=1e-6)
    np.save(tmp_path / "map.npy", Z - 3.0)
    assert np.argwhere(np.isnan(read(tmp_path / "map.npy", invalid_value=0.0, **GIVEN).z)).tolist() == [[1, 0]]


def test_size_of_a_field_is_its_longer_side_and_its_heights_are_nearly_all(tmp_path: Path) -> None:
    """A field of 0.04 x 15 um, and a spike of 400 um on one of 20 um."""
    np.savez(tmp_path / "map.npz", z_um=Z, dx_um=0.01, dy_um=5.0)
    assert read(tmp_path / "map.npz").shape == (4, 3)
    spike = np.zeros((100, 3))
    spike[50, 1] = 400.0
    np.savez(tmp_path / "map.npz", z_um=spike, pixel_um=0.2)
    assert read(tmp_path / "map.npz").z.max() == pytest.approx(400 * UM, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("unit", ["\\u00B5m", "\\u03bcm", "um", "micron"])
def test_imagej_escapes_its_micrometre(unit: str, tmp_path: Path) -> None:
    metadata = {"unit": unit, "vunit": unit}
    tifffile.imwrite(
        tmp_path / "map.tif", Z.T.astype(np.float32), imagej=True, resolution=(0.2, 0.25), metadata=metadata
    )
    found = read(tmp_path / "map.tif")
    np.testing.assert_allclose(found.z, Z * UM, rtol=1e-12)
    assert (found.dx, found.dy) == pytest.approx((5 * UM, 4 * UM), rel=1e-6, abs=0.0)


def indexed(colours: list[tuple[int, int, int]], suffix: str, path: Path, transparent: int | None = None) -> None:
    """GREY as indices 0, 1, 2 of a palette."""
    indices = np.searchsorted([0, 100, 255], GREY).astype(np.uint8)
    if suffix == ".tif":
        entries = np.zeros((3, 256), np.uint16)
        entries[:, : len(colours)] = np.array(colours, np.uint16).T * 257
        tifffile.imwrite(path, indices, photometric="palette", colormap=entries)
        return
    picture = Image.fromarray(indices, "P")
    picture.putpalette([value for colour in colours for value in colour])
    if transparent is not None:
        picture.info["transparency"] = transparent
    picture.save(path)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif"])
def test_palette_stands_for_its_grey_values(suffix: str, tmp_path: Path) -> None:
    path, options = tmp_path / f"map{suffix}", {**GIVEN, "scale": 0.1}
    indexed([(0, 0, 0), (100, 100, 100), (255, 255, 255)], suffix, path)
    np.testing.assert_allclose(read(path, **options).z, 0.1 * UM * GREY.T, rtol=1e-12)
    indexed([(0, 0, 0), (100, 90, 100), (255, 255, 255)], suffix, path)
    with pytest.raises(HeightMapError, match=r"has colours \(\w+\); expected grey values: save it as greyscale"):
        read(path, **options)
    if suffix == ".png":
        indexed([(0, 0, 0), (100, 100, 100), (255, 255, 255)], suffix, path, transparent=1)
        with pytest.raises(HeightMapError, match="is partly transparent"):
            read(path, **options)


def points(unit: str, factor: float, skip: int = -1) -> str:
    """The map as rows x, y, z in a drawn order, y from the top down."""
    listed = [f"{4 + i * 5 * factor:g} {9 + j * 4 * factor:g} {Z[i, j]:g}" for j in (2, 1, 0) for i in range(4)]
    order = [k for k in np.random.default_rng(3).permutation(12) if k != skip]
    return f"x [{unit}] y [{unit}] z [um]\n" + "".join(listed[k] + "\n" for k in order)


@pytest.mark.parametrize(("unit", "factor"), [("um", 1.0), ("mm", 1e-3)])
@pytest.mark.parametrize("skip", [-1, 5])
def test_points_whose_header_names_them_are_a_map(unit: str, factor: float, skip: int, tmp_path: Path) -> None:
    (tmp_path / "map.txt").write_text(points(unit, factor, skip))
    found, expected = read(tmp_path / "map.txt"), Z * UM
    if skip >= 0:
        expected[skip % 4, 2 - skip // 4] = np.nan
    np.testing.assert_allclose(found.z, expected, rtol=1e-12)
    assert (found.dx, found.dy) == pytest.approx((5 * UM, 4 * UM), rel=1e-9, abs=0.0)


POINTS = points("um", 1.0).partition("\n")[2]
TITLES = "x [um] y [um] z [um]\n"


def test_points_whose_header_counts_them_need_the_size_of_a_pixel(tmp_path: Path) -> None:
    (tmp_path / "map.txt").write_text("nx 4\nny 3\n" + POINTS)
    np.testing.assert_allclose(read(tmp_path / "map.txt", **GIVEN).z, Z * UM, rtol=1e-12)
    with pytest.raises(HeightMapError, match="does not declare the size of its pixels"):
        read(tmp_path / "map.txt", unit="um")


MATRIX = "1 2 3 4\n5 6 7 8\n2 1 4 3\n"
FAULTS: dict[str, tuple[str, str]] = {
    "points without a grid": (POINTS, r"12 rows of 3 columns, .*; name them above the first row as x \[mm\]"),
    "points that are counted wrong": ("nx 5\nny 3\n" + POINTS, "holds 4 places along x, its header states 5"),
    "a point twice": (TITLES + POINTS + "4 9 1\n", "lists 13 points on a grid of 3 x 4; expected each place once"),
    "points off the grid": (TITLES + POINTS.replace("14 ", "16 "), "the steps of its column x are not even"),
    "few points of a grid": (TITLES + "".join(f"{k} {k} 1\n" for k in range(9)), "lists 9 points on a grid of 9 x 9"),
    "points against a step": ("dx = 6 um\ndy = 4 um\n" + TITLES + POINTS, "x are 5 µm apart, its header states 6 µm"),
    "a damaged first row": (
        "1 2 3 x4\n" + MATRIX,
        r"line 1, column 4 is 'x4' among numbers; expected a row of heights",
    ),
    "a row of labels": ("y/x 0 5 10 15\n0 1 2 3 4\n4 5 6 7 8\n", r"line 1, column 1 is 'y/x' among numbers"),
    "one row": ("1 2 3 4\n", "has one row of 4 numbers; a map needs two, the file may be cut off"),
    "profile": (
        "0.0 1.5\n0.5 1.7\n1.0 1.9\n",
        "holds a profile of 3 heights and no map; `inkloop metrology --profile`",
    ),
    "uneven profile": ("0.0 1.5\n0.5 1.7\n1.7 1.9\n", "the steps of its column x are not even"),
}


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS)
def test_table_that_could_be_misread_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.txt").write_text(text)
    with pytest.raises(HeightMapError, match=message):
        read(tmp_path / "map.txt", **GIVEN)


def test_matrix_of_two_or_three_columns_is_one_if_its_header_counts_them(tmp_path: Path) -> None:
    for columns in (2, 3):
        z = np.arange(5.0 * columns).reshape(5, columns)
        np.savetxt(tmp_path / "map.txt", z, header=f"ncols {columns}\nnrows 5")
        np.testing.assert_allclose(read(tmp_path / "map.txt", **GIVEN).z, z.T * UM, rtol=1e-12)


@pytest.mark.parametrize(
    ("header", "step_um", "options"),
    [
        ("x [mm]; z [um]\n", 500.0, {}),
        ("Unit; um\n", 2.0, {"pixel": 2 * UM}),
        ("dx [um]; 3\nz_um\n", 3.0, {}),
    ],
)
@pytest.mark.parametrize("direction", [1, -1])
def test_profile_is_read_where_one_is_asked_for(
    header: str, step_um: float, options: Any, direction: int, tmp_path: Path
) -> None:
    x = 0.5 * np.arange(6)[::direction]
    z = np.array([1.0, -2.0, np.nan, 0.25, 4.0, 3.0])
    rows = "".join(f"{a:g}; {'' if np.isnan(b) else f'{b:g}'}\n" for a, b in zip(x, z, strict=True))
    (tmp_path / "line.csv").write_text(header + rows)
    found = read(tmp_path / "line.csv", profile=True, **options)
    np.testing.assert_allclose(found.z[:, 0], z[::direction] * UM, rtol=1e-12)
    assert (found.shape, found.dx) == ((6, 1), pytest.approx(step_um * UM, rel=1e-12, abs=0.0))
    np.save(tmp_path / "line.npy", z)
    np.testing.assert_allclose(read(tmp_path / "line.npy", profile=True, **GIVEN).z[:, 0], z * UM, rtol=1e-12)


def gwyddion(path: Path, channels: dict[str, NDArray[np.float64]], width: float, unit: str = "m") -> None:
    """A GWY file: a container of data fields (rows, columns) with their titles."""

    def text(value: str) -> bytes:
        return value.encode() + b"\0"

    def thing(name: str, items: bytes) -> bytes:
        return text(name) + struct.pack("<I", len(items)) + items

    def si_unit(name: str) -> bytes:
        return text("unitstr") + b"s" + text(name)

    items = b""
    for number, (title, data) in enumerate(channels.items()):
        rows, columns = data.shape
        field = text("xres") + b"i" + struct.pack("<i", columns) + text("yres") + b"i" + struct.pack("<i", rows)
        field += text("xreal") + b"d" + struct.pack("<d", width)
        field += text("yreal") + b"d" + struct.pack("<d", width * rows / columns)
        for key, name in (("si_unit_xy", unit), ("si_unit_z", "m")):
            field += text(key) + b"o" + thing("GwySIUnit", si_unit(name))
        field += text("data") + b"D" + struct.pack("<I", data.size) + data.astype("<f8").tobytes()
        items += text(f"/{number}/data") + b"o" + thing("GwyDataField", field)
        items += text(f"/{number}/data/title") + b"s" + text(title)
    path.write_bytes(b"GWYP" + thing("GwyContainer", items))


def test_channel_is_chosen_by_its_name_or_number(tmp_path: Path) -> None:
    pytest.importorskip("SurfaceTopography")
    height, phase = Z.T * UM, Z.T[::-1] * 2 * UM
    gwyddion(tmp_path / "map.gwy", {"Height": height, "Phase": phase}, 20 * UM)
    np.savez(tmp_path / "map.npz", z_um=Z, other_um=2 * Z[:, ::-1], pixel_um=5.0)
    tifffile.imwrite(tmp_path / "map.tif", np.stack([height, phase]).astype(np.float32) / UM, photometric="minisblack")
    options: dict[str, dict[str, Any]] = {"gwy": {}, "npz": {}, "tif": GIVEN}
    for suffix, given in options.items():
        path = tmp_path / f"map.{suffix}"
        names = {"gwy": ("Phase", "2"), "npz": ("other_um", "2"), "tif": ("2",)}[suffix]
        for name in names:
            np.testing.assert_allclose(read(path, channel=name, **given).z, phase.T, rtol=1e-6)
        np.testing.assert_allclose(read(path, channel="1", **given).z, height.T, rtol=1e-6)
        with pytest.raises(HeightMapError, match=r"channel \(--channel\) is '3'; expected one of 1 '\w+', 2 '\w+'"):
            read(path, channel="3", **given)
    assert read(tmp_path / "map.gwy").remark == "channel Height of Height, Phase, stored in m"
    with pytest.raises(HeightMapError, match=r"holds 2 pages; give channel .--channel., the number of one of them"):
        read(tmp_path / "map.tif", **GIVEN)
    (tmp_path / "map.csv").write_text(ROWS)
    with pytest.raises(HeightMapError, match=r"channel .--channel. is 'Height'; expected one of 1 'the map'"):
        read(tmp_path / "map.csv", channel="Height", **GIVEN)


@pytest.mark.parametrize(
    ("pixel", "message"),
    [
        (5.0, "field is 2e.07 µm wide; expected 1 µm to 1 m: give pixel_um"),
        (0.2 * UM, "field is 0.8 µm wide; expected 1 µm to 1 m: give pixel_um"),
    ],
)
def test_field_that_no_profiler_has_is_refused_and_corrected_by_the_option(
    pixel: float, message: str, tmp_path: Path
) -> None:
    for z in (Z, Z.T):
        np.savez(tmp_path / "map.npz", z_nm=z, pixel_m=pixel)
        with pytest.raises(HeightMapError, match=message):
            read(tmp_path / "map.npz")
        with pytest.raises(HeightMapError, match=message):
            read(tmp_path / "map.npz", pixel=pixel)
        found = read(tmp_path / "map.npz", pixel=(5 * UM, 4 * UM))
        assert (found.dx, found.dy) == (5 * UM, 4 * UM)


@pytest.mark.parametrize(
    ("z", "message"),
    [
        (Z, "heights reach from -2.25e.06 to 9e.06 µm on a field 20 µm wide; give unit"),
        (np.where(Z == 2.5, 3e38, 0.0), "to 3e.44 µm .*or invalid_value"),
        (Z * 1e-4, "heights reach from -225 to 900 µm on a field 20 µm wide"),
    ],
)
def test_heights_that_no_surface_has_are_refused(z: NDArray[Any], message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", z_m=z, pixel_um=5.0)
    with pytest.raises(HeightMapError, match=message):
        read(tmp_path / "map.npz")
    if z is Z:
        np.testing.assert_allclose(read(tmp_path / "map.npz", unit="um").z, Z * UM, rtol=1e-12)
    else:
        with pytest.raises(HeightMapError, match=r"declares heights in m|heights reach"):
            read(tmp_path / "map.npz", unit="mm" if z.max() > 1.0 else "m")


@pytest.mark.parametrize("suffix", [".npy", ".bmp"])
def test_bytes_beyond_what_a_header_states_are_refused(suffix: str, tmp_path: Path) -> None:
    """A byte in the heights shifts all after it, as a transfer in text mode does."""
    path, options = tmp_path / f"map{suffix}", {**GIVEN, "scale": 0.1}
    if suffix == ".npy":
        np.save(path, GREY)
    else:
        Image.fromarray(GREY).save(path)
    whole = path.read_bytes()
    assert read(path, **options).z.max() == pytest.approx(25.5 * UM, rel=1e-12, abs=0.0)
    path.write_bytes(whole[:-5] + b"\r" + whole[-5:])
    with pytest.raises(HeightMapError, match=r"more bytes than its header states|has \d+ bytes and states \d+"):
        read(path, **options)
