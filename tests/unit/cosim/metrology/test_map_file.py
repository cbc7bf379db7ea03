"""A height map is read as it was measured, in metres, or not at all."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sdfio
import tifffile
from PIL import Image

from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.units import M_PER_UM

NAN = np.nan
Z_UM = np.array([[0.5, 1.5, -2.25], [3.0, NAN, 4.125], [5.0, 6.5, 7.0], [8.0, 9.0, NAN]])
"""(4, 3): four pixels along x, three along y."""
DX, DY = 5.0, 4.0


def rows(write: Callable[[float], str], separator: str) -> str:
    return "".join(separator.join(map(write, row)) + "\n" for row in Z_UM.T)


def plain(invalid: str) -> Callable[[float], str]:
    return lambda height: invalid if np.isnan(height) else f"{height:g}"


def comma(invalid: str) -> Callable[[float], str]:
    return lambda height: plain(invalid)(height).replace(".", ",")


TABLES: dict[str, str | bytes] = {
    "semicolons, decimal comma, brackets": "dx [um];5,0\ndy [um];4,0\nHeight [um]\n" + rows(comma(""), ";"),
    "commas, suffixes": "dx_um,5\ndy_um,4\nz_um\n" + rows(plain("BAD"), ","),
    "trailing tabs": "dx_um\t5\ndy_um\t4\nz_um\n" + rows(plain("NaN"), "\t").replace("\n", "\t \n"),
    "trailing commas": "dx_um,5\ndy_um,4\nz_um\n" + rows(plain("NaN"), ",").replace("\n", ",\n"),
    "commas and spaces": "# dx = 5 um\n# dy = 4e-3 mm\n# unit: um\n" + rows(plain("---"), ", "),
    "tabs, empty fields": "X step\t5\tum\nY step\t4\tum\nUnit\tum\n" + rows(plain(""), "\t"),
    "spaces, decimal comma": "dx = 5 um\ndy = 4 um\nunits = um\n" + rows(comma("invalid"), " "),
    "field width, another code page": (
        "# Channel: Height\n# Width: 20 \u00b5m\n# Height: 12 \u00b5m\n# Value units: \u00b5m\n"
        + rows(plain("nan"), "\t")
    ).encode("cp1252"),
    "calibration in quotes": '"Date","2026-01-05"\n"XY calibration","5000","nm/pixel"\n"Unit","um"\n'
    '"DY","4","um"\n"Height"\n' + rows(plain("***"), ","),
    "UTF-16 with empty lines after": ("dx = 5 um\ndy = 4 um\nunit = um\n" + rows(plain("N/A"), ";") + "\n\n").encode(
        "utf-16"
    ),
}


def assert_is_the_map(found: HeightMap) -> None:
    np.testing.assert_allclose(found.z, Z_UM * M_PER_UM, rtol=1e-6, atol=1e-15)
    assert (found.dx, found.dy) == (
        pytest.approx(DX * M_PER_UM, rel=1e-6, abs=0.0),
        pytest.approx(DY * M_PER_UM, rel=1e-6, abs=0.0),
    )


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_table_is_read_with_its_units(table: str | bytes, tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_bytes(table if isinstance(table, bytes) else table.encode())
    assert_is_the_map(read(path))


def write_npy(path: Path) -> dict[str, Any]:
    np.save(path, Z_UM)
    return {"unit": "um", "pixel": (DX * M_PER_UM, DY * M_PER_UM)}


def write_npz(path: Path) -> dict[str, Any]:
    np.savez(path, z_um=Z_UM, dx_um=DX, dy_um=DY)
    return {}


def write_float_tiff(path: Path) -> dict[str, Any]:
    tifffile.imwrite(path, (Z_UM.T * 1e-3).astype(np.float32), resolution=(2000, 2500), resolutionunit="CENTIMETER")
    return {"unit": "mm"}


def write_count_tiff(path: Path) -> dict[str, Any]:
    counts = np.where(np.isnan(Z_UM.T), -(2**15), Z_UM.T * 8).astype(np.int16)
    tifffile.imwrite(path, counts)
    return {"unit": "um", "pixel": (DX * M_PER_UM, DY * M_PER_UM), "scale": 0.125, "invalid_value": -(2**15)}


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
    sdfio.write(path, Z_UM.T * M_PER_UM, x_scale=DX * M_PER_UM, y_scale=DY * M_PER_UM, z_scale=1e-12)
    return {}


def write_sdf_text(path: Path) -> dict[str, Any]:
    scales: dict[str, Any] = {"x_scale": DX * M_PER_UM, "y_scale": DY * M_PER_UM, "z_scale": 1e-12}
    sdfio.write(path, Z_UM.T * M_PER_UM, **scales, format=sdfio.FileFormat.ASCII)
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


def write_x3p(path: Path) -> dict[str, Any]:
    topography = pytest.importorskip("SurfaceTopography")
    masked = np.ma.masked_invalid(Z_UM)
    topography.Topography(masked, (4 * DX, 3 * DY), unit="um").to_x3p(str(path))
    return {}


WRITERS = {
    "npy": write_npy,
    "npz": write_npz,
    "float.tif": write_float_tiff,
    "count.tif": write_count_tiff,
    "imagej.tif": write_imagej_tiff,
    "ome.tif": write_ome_tiff,
    "sdf": write_sdf,
    "text.sdf": write_sdf_text,
    "sur": write_sur,
    "x3p": write_x3p,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_map(name: str, tmp_path: Path) -> None:
    if name in ("sur", "x3p"):
        pytest.importorskip("SurfaceTopography")
    path = tmp_path / f"map.{name}"
    assert_is_the_map(read(path, **WRITERS[name](path)))


def test_number_of_what_was_not_measured_is_never_a_height(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    np.savez(path, z_um=np.where(np.isnan(Z_UM), -9999.0, Z_UM), dx_um=DX, dy_um=DY)
    assert_is_the_map(read(path, invalid_value=-9999.0))


def test_rows_lie_along_the_given_axis(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", Z_UM.T)
    assert_is_the_map(read(tmp_path / "map.npy", unit="um", pixel=(DX * M_PER_UM, DY * M_PER_UM), rows_along="x"))


HEADER = "dx = 5 um\ndy = 4 um\nunit = um\n"
FAULTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "nothing declared": ("1 2 3\n4 5 6\n", "does not declare the unit .* does not declare the size of its pixels", {}),
    "unit against unit": (HEADER + "1 2\n3 4\n", "heights in um, but unit is 'mm'", {"unit": "mm"}),
    "pixel against pixel": (HEADER + "1 2\n3 4\n", "pixels of 5 x 4 µm, but pixel_um is 5000", {"pixel": 5e-3}),
    "unknown unit": ("1 2\n3 4\n", "unit is 'inch'; expected one of nm, um", {"unit": "inch", "pixel": 5e-6}),
    "a word": (HEADER + "1 2 3\n4 five 6\n", "line 5, column 2 is 'five'; expected a height", {}),
    "cut off": (HEADER + "1 2 3\n4 5\n", "line 5 has 2 fields, the rows before it 3; the file may be cut off", {}),
    "two decimal signs": (HEADER + "1.5;2\n1,5;2\n", "numbers with , and numbers with .", {}),
    "points": (HEADER + "0 0 1\n5 0 1\n0 4 1\n5 4 1\n", "4 rows of 3 columns, .* a list of points", {}),
    "empty": ("", r"no row of numbers \(lines read: 0\)", {}),
    "scale of nothing": (HEADER + "1 2\n3 4\n", "count_scale is 0.0; expected a height per count", {"scale": 0.0}),
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


def test_counts_without_their_height_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "map.tif", np.ones((3, 4), np.uint16))
    with pytest.raises(
        HeightMapError, match=r"whole-number counts \(uint16\); give count_scale \(--count-scale\), the height"
    ):
        read(tmp_path / "map.tif", unit="um", pixel=5e-6)


def test_dots_per_inch_are_not_believed(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "map.tif", np.ones((3, 4), np.float32), resolution=(72, 72), resolutionunit="INCH")
    with pytest.raises(HeightMapError, match="does not declare the size of its pixels"):
        read(tmp_path / "map.tif", unit="um")


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


def test_compressed_tiff_is_read(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "map.tif", np.ones((500, 400), np.float32), compression="zlib")
    assert read(tmp_path / "map.tif", unit="um", pixel=5e-6).z.shape == (400, 500)


@pytest.mark.parametrize("suffix", ["csv", "npy", "npz", "tif", "sdf", "sur", "x3p", "xyz123"])
def test_rubbish_and_absence_are_reported_with_the_path(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"map.{suffix}"
    with pytest.raises(HeightMapError, match=r"map\.\w+: cannot be read: No such file"):
        read(path, unit="um", pixel=5e-6)
    path.write_bytes(b"\x00\x01rubbish" * 40)
    with pytest.raises(HeightMapError, match=f"map.{suffix}"):
        read(path, unit="um", pixel=5e-6)


def test_missing_library_is_reported_with_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "SurfaceTopography", None)
    (tmp_path / "map.sur").write_bytes(b"DIGITAL SURF")
    with pytest.raises(HeightMapError, match=r"pip install 'inkloop\[metrology\]'"):
        read(tmp_path / "map.sur")


def test_map_of_another_shape_than_a_surface_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", np.zeros(5))
    with pytest.raises(HeightMapError, match=r"shape \(5,\); expected rows and columns"):
        read(tmp_path / "map.npy", unit="um", pixel=5e-6)


@pytest.mark.parametrize("suffix", [".png", ".bmp"])
def test_picture_is_read_as_counts_that_need_their_scale(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"map{suffix}"
    counts = np.array([[0, 10, 20], [30, 40, 255]], np.uint8)
    Image.fromarray(counts).save(path)
    with pytest.raises(HeightMapError, match="whole-number counts"):
        read(path, unit="um", pixel=5e-6)
    found = read(path, unit="um", pixel=5e-6, scale=0.5, invalid_value=255)
    expected = np.where(counts == 255, np.nan, counts * 0.5e-6).T
    np.testing.assert_allclose(found.z, expected, rtol=1e-12)


def test_sixteen_bits_of_a_picture_are_kept(tmp_path: Path) -> None:
    counts = np.array([[0, 1], [256, 65535]], np.uint16)
    Image.fromarray(counts).save(tmp_path / "map.png")
    found = read(tmp_path / "map.png", unit="nm", pixel=5e-6, scale=1.0)
    np.testing.assert_allclose(found.z, counts.T * 1e-9, rtol=1e-12)
