"""A height map is read as it was measured, in metres, or not at all; written ones come back, in other readers too."""

from __future__ import annotations

import hashlib
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import sdfio
import tifffile
from PIL import Image

from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.map_readers import chosen, read_instrument, read_tiff
from inkloop.metrology.map_writing import NAMESPACE, write
from inkloop.metrology.table_header import read_header

UM = 1e-6
NAN = np.nan
Z_UM = np.array([[0.5, 1.5, -2.25], [3.0, NAN, 4.125], [5.0, 6.5, 7.0], [8.0, 9.0, NAN]])
"""(4, 3): four pixels along x, three along y."""
DX, DY = 5.0, 4.0
PIXEL = (DX * UM, DY * UM)


def rows(separator: str, invalid: str, point: str = ".") -> str:
    def write(height: float) -> str:
        return invalid if np.isnan(height) else f"{height:g}".replace(".", point)

    return "".join(separator.join(map(write, row)) + "\n" for row in Z_UM.T)


TABLES: dict[str, str | bytes] = {
    "semicolons, decimal comma, brackets": "dx [um];5,0\ndy [um];4,0\nHeight [um]\n" + rows(";", "", ","),
    "commas, suffixes": "dx_um,5\ndy_um,4\nz_um\n" + rows(",", "BAD"),
    "trailing tabs": "dx_um\t5\ndy_um\t4\nz_um\n" + rows("\t", "NaN").replace("\n", "\t \n"),
    "trailing commas": "dx_um,5\ndy_um,4\nz_um\n" + rows(",", "NaN").replace("\n", ",\n"),
    "commas and spaces": "# dx = 5 um\n# dy = 4e-3 mm\n# unit: um\n" + rows(", ", "---"),
    "spaces on both sides": "dx = 5 um\ndy = 4 um\nunit = um\n" + rows(" ; ", "bad"),
    "tabs, empty fields": "X step\t5\tum\nY step\t4\tum\nUnit\tum\n" + rows("\t", ""),
    "spaces, decimal comma": "dx = 5 um\ndy = 4 um\nunits = um\n" + rows(" ", "invalid", ","),
    "field width, another code page": (
        "# Channel: Height\n# Width: 20 \u00b5m\n# Height: 12 \u00b5m\n# Value units: \u00b5m\n" + rows("\t", "nan")
    ).encode("cp1252"),
    "calibration in quotes": '"Date","2026-01-05"\n"XY calibration","5000","nm/pixel"\n"Unit","um"\n'
    '"DY","4","um"\n"Height"\n' + rows(",", "***"),
    "UTF-16 with the high byte first, a word in title case": b"\xfe\xff"
    + ("dx = 5 um\ndy = 4 um\nunit = um\n" + rows("\t", "Invalid")).encode("utf-16-be"),
    "UTF-16 with empty lines after": ("dx = 5 um\ndy = 4 um\nunit = um\n" + rows(";", "N/A") + "\n\n").encode("utf-16"),
}


def assert_is_the_map(found: HeightMap) -> None:
    np.testing.assert_allclose(found.z, Z_UM * UM, rtol=1e-6, atol=1e-15)
    assert (found.dx, found.dy) == pytest.approx(PIXEL, rel=1e-6, abs=0.0)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_table_is_read_with_its_units(table: str | bytes, tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_bytes(table if isinstance(table, bytes) else table.encode())
    assert_is_the_map(read(path))


@pytest.mark.parametrize(
    ("lines", "unit", "pixel_um"),
    [
        (["pixel size = 5 um", "height unit = nm"], "nm", (5.0, 5.0)),
        (["pixel size x [mm] = 0.002", "pixel size y [mm] = 0.003", "Topography [nm]"], "nm", (2.0, 3.0)),
        (["spacing = 4 um", "dy = 6 um"], None, (4.0, 6.0)),
        (["width = 80 um", "height = 30 um"], None, (8.0, 6.0)),  # of 10 columns and 5 rows
        (["field height = 30 um"], None, None),  # along x nothing is known
        (["dx = 2", "dy = 3"], None, None),  # no unit, no length
        (["gain = 5 um", "units: m"], "m", None),
    ],
)
def test_header_states_unit_and_pixel(lines: list[str], unit: str | None, pixel_um: Any) -> None:
    header = read_header(lines)
    pixel = header.pixel(columns=10, rows=5)
    assert header.unit == unit
    assert (pixel and [size / UM for size in pixel]) == (pixel_um and pytest.approx(list(pixel_um), rel=1e-9, abs=0.0))


def write_npy(path: Path) -> dict[str, Any]:
    np.save(path, Z_UM)
    return {"unit": "um", "pixel": PIXEL}


def write_rows_npy(path: Path) -> dict[str, Any]:
    np.save(path, Z_UM.T)
    return {"unit": "um", "pixel": PIXEL, "rows_along": "x"}


def write_npz(path: Path) -> dict[str, Any]:
    np.savez(path, z_um=np.where(np.isnan(Z_UM), -9999.0, Z_UM), dx_um=DX, dy_um=DY)
    return {"invalid_value": -9999.0}


def write_float_tiff(path: Path) -> dict[str, Any]:
    heights = (Z_UM.T * 1e-3).astype(np.float32)
    tifffile.imwrite(path, heights, resolution=(2000, 2500), resolutionunit="CENTIMETER", compression="zlib")
    return {"unit": "mm"}


def write_count_tiff(path: Path) -> dict[str, Any]:
    counts = np.where(np.isnan(Z_UM.T), -(2**15), Z_UM.T * 8).astype(np.int16)
    tifffile.imwrite(path, counts)
    return {"unit": "um", "pixel": PIXEL, "scale": 0.125, "invalid_value": -(2**15)}


def write_imagej_tiff(path: Path) -> dict[str, Any]:
    counts = np.where(np.isnan(Z_UM.T), 0, (Z_UM.T + 10) * 8).astype(np.uint16)
    metadata = {"unit": "um", "vunit": "um", "cf": 0, "c0": -10.0, "c1": 0.125}
    tifffile.imwrite(path, counts, imagej=True, resolution=(1 / DX, 1 / DY), metadata=metadata)
    return {"invalid_value": -10.0}


def write_ome_tiff(path: Path) -> dict[str, Any]:
    metadata = {"axes": "YX", "PhysicalSizeX": DX, "PhysicalSizeXUnit": "\u00b5m", "PhysicalSizeY": 4000.0}
    tifffile.imwrite(path, Z_UM.T.astype(np.float32), ome=True, metadata={**metadata, "PhysicalSizeYUnit": "nm"})
    return {"unit": "um"}


def write_sdf(path: Path) -> dict[str, Any]:
    form = sdfio.FileFormat.ASCII if path.name.startswith("map.text") else sdfio.FileFormat.BINARY
    sdfio.write(path, Z_UM.T * UM, x_scale=DX * UM, y_scale=DY * UM, z_scale=1e-12, format=form)
    return {}


def write_sur(path: Path) -> dict[str, Any]:
    """The 512 byte header of Digital Surf and 16 bit counts of 1/8 um; zmin - 2 marks what was not measured."""
    counts = np.where(np.isnan(Z_UM.T), -20, Z_UM.T * 8).astype("<i2")
    names = [text.encode().ljust(16) for text in ("X", "Y", "Z", "mm", "mm", "um", "mm", "mm", "um")]
    header = struct.pack(
        "<12sHHHH30s30sHHHHHIIHiiiiI3f16s16s16s16s16s16s16s16s16s3fHHHIIIHHHHHHHfIIHHH128s3f34s",
        b"DIGITAL SURF", 0, 1, 1, 2, b"map", b"profiler", 0, 0, 0, 1, 1, 0, 0, 16,
        -18, 72, 4, 3, 12, DX * 1e-3, DY * 1e-3, 0.125, *names, 1.0, 1.0, 1.0,
        0, 0, 0, 0, 0, 0, *[1] * 7, 0.0, 0, 0, 0, 0, 0, b"", 0.0, 0.0, 0.0, b"",
    )  # fmt: skip
    path.write_bytes(header + counts.tobytes())
    return {}


WRITERS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "npy": write_npy,
    "rows.npy": write_rows_npy,
    "npz": write_npz,
    "float.tif": write_float_tiff,
    "count.tif": write_count_tiff,
    "imagej.tif": write_imagej_tiff,
    "ome.tif": write_ome_tiff,
    "sdf": write_sdf,
    "text.sdf": write_sdf,
    "sur": write_sur,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_map(name: str, tmp_path: Path) -> None:
    if name == "sur":
        pytest.importorskip("SurfaceTopography")
    path = tmp_path / f"map.{name}"
    found = read(path, **WRITERS[name](path))
    assert_is_the_map(found)
    stored = "m" if name.endswith("sdf") else "mm" if name.startswith("float") else "um"
    assert found.remark == ("channel Default, " if name == "sur" else "") + f"stored in {stored}"
    assert str(found) == f"4 x 3 pixels of 5 x 4 µm, a field of 20 x 12 µm, heights from -2.25 to 9 µm, {found.remark}"


Z = np.arange(6.0).reshape(3, 2)


@pytest.mark.parametrize(
    ("arrays", "options", "height_um", "pixel_um"),
    [
        ({"height_mm": Z, "pixel_mm": 5.0}, {}, 5000.0, (5000.0, 5000.0)),
        ({"z": Z, "dx_um": 2.0, "dy_nm": 3000.0}, {"unit": "um"}, 5.0, (2.0, 3.0)),
        ({"anything": Z, "other": np.ones(4)}, {"unit": "nm", "pixel": 1e-6}, 5e-3, (1.0, 1.0)),
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
        ({"z_um": Z, "height_um": Z}, "expected one map"),
        ({}, "holds nothing; expected one map"),
    ],
)
def test_arrays_without_one_map_are_listed(arrays: Any, message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(HeightMapError, match=message):
        read(tmp_path / "map.npz", unit="um", pixel=1e-6)


def test_first_of_several_arrays_is_chosen_by_its_name_and_two_numbers_are_no_pixel(tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", other_um=2.0 * Z, z_um=Z, pixel_um=np.ones(2))
    found = read(tmp_path / "map.npz", channel="other_um", pixel=1e-6)
    assert found.z[2, 1] == pytest.approx(10.0 * UM, rel=1e-9, abs=0.0)
    with pytest.raises(HeightMapError, match="does not declare the size of its pixels"):
        read(tmp_path / "map.npz")


def test_pages_of_tiff_that_differ_in_size_are_numbered_and_the_first_is_read(tmp_path: Path) -> None:
    path = tmp_path / "map.tif"
    with tifffile.TiffWriter(path) as file:
        for columns in (3, 5):
            file.write(np.full((2, columns), float(columns), np.float32))
    first, second = (read(path, unit="um", pixel=UM, channel=channel) for channel in (None, "2"))
    assert (first.shape, second.shape) == ((3, 2), (5, 2))
    assert [each.remark.partition(",")[0] for each in (first, second)] == ["page 1 of 2", "page 2 of 2"]


def test_sizes_of_ome_are_micrometres_where_nothing_else_is_stated(tmp_path: Path) -> None:
    sizes = {"axes": "YX", "PhysicalSizeX": 5.0, "PhysicalSizeY": 4.0}
    tifffile.imwrite(tmp_path / "map.tif", np.ones((2, 3), np.float32), ome=True, metadata=sizes)
    found = read(tmp_path / "map.tif", unit="um")
    assert (found.dx, found.dy) == pytest.approx((5 * UM, 4 * UM), rel=1e-9, abs=0.0)


def test_palette_of_blue_and_yellow_is_no_grey(tmp_path: Path) -> None:
    picture = Image.fromarray(np.array([[0, 100], [200, 255]], np.uint8), "L").convert("P")
    picture.putpalette([value for k in range(256) for value in (k, k, 255 - k)])
    picture.save(tmp_path / "map.tif")
    with pytest.raises(HeightMapError, match=r"has colours \(palette\)"):
        read(tmp_path / "map.tif", unit="um", pixel=UM, scale=1.0)


def test_remark_of_numbers_is_no_row(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text(HEADER + "# 1 2 3 4 5 6\n1 2 3\n4 5 6\n")
    assert read(tmp_path / "map.csv").shape == (3, 2)


def test_channel_whose_name_occurs_twice_is_chosen_by_its_number() -> None:
    assert chosen(Path("map"), ["height", "height"], "2") == 1
    with pytest.raises(HeightMapError, match="expected one of 1 'height', 2 'height'"):
        chosen(Path("map"), ["height", "height"], "height")


def test_pixels_of_tiff_are_those_of_its_tags(tmp_path: Path) -> None:
    """Dots per inch are not believed, and half of a size is none."""
    heights, path = np.ones((2, 3), np.float32), tmp_path / "map.tif"
    for options in (
        {"ome": True, "metadata": {"axes": "YX", "PhysicalSizeX": 3.0}},
        {"imagej": True, "resolution": (0.5, 0.25), "metadata": {"unit": "furlong"}},
        {"resolution": (300, 300), "resolutionunit": "INCH"},
        {"resolution": (300, 300), "resolutionunit": "NONE"},
    ):
        tifffile.imwrite(path, heights, **options)
        with pytest.raises(HeightMapError, match="does not declare the size of its pixels"):
            read(path, unit="um")


def test_tiff_that_declares_more_pixels_than_it_can_hold_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "map.tif"
    tifffile.imwrite(path, np.ones((3, 4), np.float32))
    damaged = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as file:
        for name in ("ImageLength", "ImageWidth"):
            at = file.pages.first.tags[name].valueoffset
            damaged[at : at + 2] = b"\xff\xff"
    path.write_bytes(damaged)
    with pytest.raises(HeightMapError, match=rf"declares 65535 x 65535 pixels of float32 in {len(damaged)} bytes"):
        read(path, unit="um", pixel=5e-6)


@pytest.mark.parametrize("suffix", [".png", ".bmp"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_picture_is_read_as_counts_that_need_their_scale(suffix: str, dtype: Any, tmp_path: Path) -> None:
    if (suffix, dtype) == (".bmp", np.uint16):
        pytest.skip("BMP has 8 bits")
    path, most = tmp_path / f"map{suffix}", np.iinfo(dtype).max
    counts = np.array([[0, 10, 20], [30, 40, most]], dtype)
    Image.fromarray(counts).save(path)
    with pytest.raises(HeightMapError, match="whole-number counts"):
        read(path, unit="um", pixel=5e-6)
    found = read(path, unit="um", pixel=5e-6, scale=0.5, invalid_value=most)
    np.testing.assert_allclose(found.z, np.where(counts == most, np.nan, counts * 0.5e-6).T, rtol=1e-12)


HEADER = "dx = 5 um\ndy = 4 um\nunit = um\n"
FAULTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "nothing declared": ("1 2 3\n4 5 6\n", "does not declare the size of its pixels.* does not declare the unit ", {}),
    "unit against unit": (HEADER + "1 2\n3 4\n", "heights in um, but unit is 'mm'", {"unit": "mm"}),
    "pixel against pixel": (HEADER + "1 2\n3 4\n", "pixels of 5 x 4 µm, but pixel_um is 5000; leave", {"pixel": 5e-3}),
    "two pixel sizes": (HEADER + "1 2\n3 4\n", "but pixel_um is 5 x 6; leave it out", {"pixel": (5e-6, 6e-6)}),
    "slightly another pixel": (HEADER + "1 2\n3 4\n", "but pixel_um is 5.2 x 4", {"pixel": (5.2e-6, 4e-6)}),
    "unknown unit": ("1 2\n3 4\n", "unit is 'inch'; expected one of nm, um", {"unit": "inch", "pixel": 5e-6}),
    "a word": (HEADER + "1 2 3\n4 five 6\n", "line 5, column 2 is 'five'; expected a height", {}),
    "a truth value": (HEADER + "1;True\n4;True\n", "line 4, column 2 is 'True'|no row of numbers", {}),
    "cut off": (HEADER + "1 2 3\n4 5\n", "line 5 has 2 fields, the rows before it 3; the file may be cut off", {}),
    "cut off at a separator": (HEADER + "1;2;3\n4;5\n", "line 5 has 2 fields, the rows before it 3", {}),
    "two decimal signs": (HEADER + "1.5;2\n1,5;2\n", "numbers with , and numbers with .", {}),
    "points": (HEADER + "0 0 1\n5 0 1\n0 4 1\n5 4 1\n", "4 rows of 3 columns, .* a list of points", {}),
    "empty": ("", r"no row of numbers \(lines read: 0\)", {}),
    "scale of nothing": (HEADER + "1 2\n3 4\n", "count_scale is 0.0; expected a height per count", {"scale": 0.0}),
    "pixel of nothing": ("1 2\n3 4\n", "pixel_um is 0; expected lengths above 0", {"unit": "um", "pixel": 0.0}),
}


@pytest.mark.parametrize(("text", "message", "options"), FAULTS.values(), ids=FAULTS)
def test_faulty_table_is_refused_with_a_message(
    text: str, message: str, options: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "map.csv"
    path.write_text(text)
    with pytest.raises(HeightMapError, match=message) as refusal:
        read(path, **options)
    assert str(path) in str(refusal.value)


def test_options_that_agree_with_the_file_are_taken(tmp_path: Path) -> None:
    """Files round the size of their pixels."""
    (tmp_path / "map.csv").write_text(HEADER + "1 2\n3 4\n")
    assert read(tmp_path / "map.csv", unit="um", pixel=(5.04e-6, 4e-6)).dx == pytest.approx(5e-6, rel=1e-12, abs=0.0)


def test_pixel_of_a_field_that_is_too_wide_along_one_axis_gives_way_to_the_option(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text("dx = 5 um\ndy = 4 m\nunit = um\n1 2\n3 4\n")
    assert read(tmp_path / "map.csv", pixel=(5e-6, 4e-6)).dy == pytest.approx(4e-6, rel=1e-12, abs=0.0)


def test_one_height_that_no_field_has_is_a_number_without_a_height(tmp_path: Path) -> None:
    z = np.zeros((20, 20))
    z[3, 4] = 1e10
    np.save(tmp_path / "map.npy", z)
    with pytest.raises(HeightMapError, match=r"from 0 to 1e\+10 µm on a field 100 µm wide"):
        read(tmp_path / "map.npy", unit="um", pixel=5e-6)


@pytest.mark.parametrize("suffix", ["csv", "npy", "npz", "tif", "sdf", "sur", "x3p", "xyz123"])
def test_rubbish_and_absence_are_reported_with_the_path(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"map.{suffix}"
    with pytest.raises(HeightMapError, match=r"map\.\w+: cannot be read: No such file"):
        read(path, unit="um", pixel=5e-6)
    path.write_bytes(b"\x00\x01rubbish" * 40)
    with pytest.raises(HeightMapError, match=f"map.{suffix}"):
        read(path, unit="um", pixel=5e-6)


def test_map_of_another_shape_or_size_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", np.zeros(5))
    with pytest.raises(HeightMapError, match=r"holds a profile of 5 heights and no map; `inkloop metrology --profile`"):
        read(tmp_path / "map.npy", unit="um", pixel=5e-6)
    found = HeightMap(np.array([[1.0, np.inf], [-np.inf, 2.0]]), 1e-6, 2e-6)
    assert found.valid.tolist() == [[True, False], [False, True]]
    assert np.isnan(found.z).tolist() == [[False, True], [True, False]]
    with pytest.raises(ValueError, match="read-only"):
        found.z[0, 0] = 2.0
    for dx, dy in ((0.0, 1.0), (1.0, -1.0), (np.inf, 1.0), (1.0, np.nan)):
        with pytest.raises(HeightMapError, match=r"height map: the pixel size d[xy] is .* m; needs a length above 0"):
            HeightMap(Z, dx, dy)


WRITTEN = (263.256e-6, 42.333e-6)


def uneven(holes: bool = True) -> HeightMap:
    """(5, 3) heights of all signs and sizes that no exchange of axes keeps."""
    z = np.random.default_rng(3).normal(0.0, 1e-5, (5, 3)) + np.arange(15).reshape(5, 3) * 1e-4
    if holes:
        z[1, 2] = z[4, 0] = np.nan
    return HeightMap(z, *WRITTEN, source="uneven")


@pytest.mark.parametrize("form", ["npy", "sdf", "x3p", "tiff"])
@pytest.mark.parametrize("holes", [False, True])
def test_written_heights_come_back_to_the_bit(form: str, holes: bool, tmp_path: Path) -> None:
    """TIFF holds float32 in um."""
    map_, path = uneven(holes), tmp_path / f"map.{form}"
    write(path, map_, form)
    found = read(path, unit="m", pixel=WRITTEN) if form == "npy" else read(path)
    expected = (map_.z * 1e6).astype(np.float32).astype(np.float64) * UM if form == "tiff" else map_.z
    np.testing.assert_array_equal(found.z, expected)
    assert (found.dx, found.dy) == pytest.approx(WRITTEN, rel=1e-6, abs=0.0)


def test_other_readers_see_the_map_that_was_written(tmp_path: Path) -> None:
    for form in ("tiff", "sdf", "x3p"):
        write(tmp_path / f"map.{form}", uneven(), form)
    with tifffile.TiffFile(tmp_path / "map.tiff") as file:
        page = file.pages.first
        assert (page.dtype, page.resolutionunit) == (np.float32, 3)
        assert tuple(0.01 / per_cm for per_cm in page.resolution) == pytest.approx(WRITTEN, rel=1e-6, abs=0.0)
        assert page.asarray()[0, 1] == pytest.approx(uneven().z[1, 0] * 1e6, rel=1e-6, abs=0.0), "row 0 is y = 0"
    surface = sdfio.read(tmp_path / "map.sdf")
    assert (surface.header.x_scale, surface.header.y_scale, surface.header.z_scale) == (*WRITTEN, 1.0)
    np.testing.assert_array_equal(surface.data, uneven().z.T)
    pytest.importorskip("SurfaceTopography")
    contents = read_instrument(tmp_path / "map.x3p")
    np.testing.assert_array_equal(contents.values, uneven().z)
    assert (contents.unit, contents.pixel) == ("m", pytest.approx(WRITTEN, rel=1e-12, abs=0.0))


def test_x3p_keeps_its_standard(tmp_path: Path) -> None:
    """Read by hand: the checksum of the document, that of the heights, and x as the fastest index."""
    write(tmp_path / "map.x3p", uneven(), "x3p")
    with zipfile.ZipFile(tmp_path / "map.x3p") as archive:
        xml, checksum = archive.read("main.xml"), archive.read("md5checksum.hex").decode()
        root = ElementTree.fromstring(xml)
        heights = archive.read(root.findtext("Record3/DataLink/PointDataLink", ""))
    assert root.tag == f"{{{NAMESPACE}}}ISO5436_2"
    assert [record.tag for record in root] == ["Record1", "Record2", "Record3", "Record4"]
    assert checksum.split() == [hashlib.md5(xml).hexdigest().upper(), "*main.xml"]
    assert root.findtext("Record4/ChecksumFile") == "md5checksum.hex"
    assert root.findtext("Record3/DataLink/MD5ChecksumPointData") == hashlib.md5(heights).hexdigest().upper()
    sizes = [int(root.findtext(f"Record3/MatrixDimension/Size{axis}", "")) for axis in "XYZ"]
    steps = tuple(float(root.findtext(f"Record1/Axes/C{axis}/Increment", "")) for axis in "XY")
    assert (sizes, steps) == ([5, 3, 1], WRITTEN)
    assert [root.findtext(f"Record1/Axes/CZ/{key}") for key in ("AxisType", "DataType")] == ["A", "D"]
    np.testing.assert_array_equal(np.frombuffer(heights, "<f8").reshape(3, 5).T, uneven().z)


def test_a_map_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "map.sdf").write_text("before")
    monkeypatch.setattr(sdfio, "write", fail)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path / "map.sdf", uneven(), "sdf")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]


def test_picture_comes_from_the_file_alone(tmp_path: Path) -> None:
    """OME may place its pixels in other files."""
    tifffile.imwrite(tmp_path / "other.ome.tif", np.full((2, 3), 7.0, np.float32), ome=True, metadata={"axes": "YX"})
    text = str(tifffile.TiffFile(tmp_path / "other.ome.tif").ome_metadata)
    place = re.search(r"<TiffData[^>]*/>", text)
    assert place is not None
    there = '<TiffData IFD="0" PlaneCount="1"><UUID FileName="other.ome.tif">urn:uuid:1</UUID></TiffData>'
    own = np.arange(6, dtype=np.float32).reshape(2, 3)
    tifffile.imwrite(tmp_path / "a.tif", own, description=text.replace(place[0], there), metadata=None)
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif").values, own)


def test_description_that_is_no_xml_says_nothing_of_the_picture(tmp_path: Path) -> None:
    own = np.arange(6, dtype=np.float32).reshape(2, 3)
    tifffile.imwrite(tmp_path / "a.tif", own, description="<no description>", metadata=None)
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif").values, own)


def test_zip_that_is_no_x3p_is_left_to_the_library(tmp_path: Path) -> None:
    """Other instruments zip their files too."""
    pytest.importorskip("SurfaceTopography")
    with zipfile.ZipFile(tmp_path / "it.qep", "w") as archive:
        archive.writestr("other.xml", "<a/>")
    with pytest.raises(HeightMapError, match="SurfaceTopography cannot read it") as refused:
        read_instrument(tmp_path / "it.qep")
    assert "main.xml" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "words"), [("a.toml", "scenario"), ("result.nc", "name its folder"), ("run.json", "no height map")]
)
def test_file_of_a_run_is_no_height_map(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / name).write_text("{}")
    with pytest.raises(HeightMapError, match=words):
        read(tmp_path / name)
