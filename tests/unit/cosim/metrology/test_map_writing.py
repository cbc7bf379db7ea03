"""Written height maps come back to the bit, NaN included, and other readers see the same."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import sdfio
import tifffile

from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.map_readers import read_instrument
from inkloop.metrology.map_writing import NAMESPACE, write

DX, DY = 263.256e-6, 42.333e-6


def uneven(holes: bool = True) -> HeightMap:
    """(5, 3) heights of all signs and sizes that no exchange of axes keeps."""
    z = np.random.default_rng(3).normal(0.0, 1e-5, (5, 3)) + np.arange(15).reshape(5, 3) * 1e-4
    if holes:
        z[1, 2] = z[4, 0] = np.nan
    return HeightMap(z, DX, DY, source="uneven")


@pytest.mark.parametrize("form", ["npy", "sdf", "x3p"])
@pytest.mark.parametrize("holes", [False, True])
def test_heights_come_back_to_the_bit(form: str, holes: bool, tmp_path: Path) -> None:
    map_, path = uneven(holes), tmp_path / f"map.{form}"
    write(path, map_, form)
    found = read(path, unit="m", pixel=(DX, DY)) if form == "npy" else read(path)
    assert found.z.tobytes() == map_.z.tobytes()
    assert (found.dx, found.dy) == pytest.approx((DX, DY), rel=1e-12, abs=0.0)


def test_tiff_holds_float32_in_um(tmp_path: Path) -> None:
    write(tmp_path / "map.tif", uneven(), "tiff")
    found = read(tmp_path / "map.tif")
    as_stored = (uneven().z * 1e6).astype(np.float32).astype(np.float64) * 1e-6
    assert np.array_equal(found.z, as_stored, equal_nan=True)
    assert (found.dx, found.dy) == pytest.approx((DX, DY), rel=1e-6, abs=0.0)
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        page = file.pages.first
        assert page.dtype == np.float32
        assert page.resolutionunit == 3
        assert tuple(0.01 / per_cm for per_cm in page.resolution) == pytest.approx((DX, DY), rel=1e-6, abs=0.0)
        assert page.asarray()[0, 1] == pytest.approx(uneven().z[1, 0] * 1e6, rel=1e-6, abs=0.0), "row 0 is y = 0"


def test_x3p_keeps_its_standard(tmp_path: Path) -> None:
    """Read by hand: the checksum of the document, that of the heights, and x as the fastest index."""
    write(tmp_path / "map.x3p", uneven(), "x3p")
    with zipfile.ZipFile(tmp_path / "map.x3p") as archive:
        xml, checksum = archive.read("main.xml"), archive.read("md5checksum.hex").decode()
        root = ElementTree.fromstring(xml)
        assert root.tag == f"{{{NAMESPACE}}}ISO5436_2"
        assert checksum.split() == [hashlib.md5(xml).hexdigest().upper(), "*main.xml"]
        assert root.findtext("Record4/ChecksumFile") == "md5checksum.hex"
        heights = archive.read(root.findtext("Record3/DataLink/PointDataLink", ""))
    assert root.findtext("Record3/DataLink/MD5ChecksumPointData") == hashlib.md5(heights).hexdigest().upper()
    sizes = [int(root.findtext(f"Record3/MatrixDimension/Size{axis}", "")) for axis in "XYZ"]
    steps = [float(root.findtext(f"Record1/Axes/C{axis}/Increment", "")) for axis in "XY"]
    assert (sizes, steps) == ([5, 3, 1], [DX, DY])
    assert [root.findtext(f"Record1/Axes/CZ/{key}") for key in ("AxisType", "DataType")] == ["A", "D"]
    assert np.array_equal(np.frombuffer(heights, "<f8").reshape(3, 5).T, uneven().z, equal_nan=True)
    assert [record.tag for record in root] == ["Record1", "Record2", "Record3", "Record4"]


def test_surface_topography_reads_x3p_alike(tmp_path: Path) -> None:
    write(tmp_path / "map.x3p", uneven(), "x3p")
    contents = read_instrument(tmp_path / "map.x3p")
    assert np.array_equal(contents.values, uneven().z, equal_nan=True)
    assert contents.unit == "m"
    assert contents.pixel == pytest.approx((DX, DY), rel=1e-12, abs=0.0)


def test_sdf_states_metres_and_rows_along_x(tmp_path: Path) -> None:
    write(tmp_path / "map.sdf", uneven(), "sdf")
    surface = sdfio.read(tmp_path / "map.sdf")
    header = surface.header
    assert (header.x_scale, header.y_scale, header.z_scale) == (DX, DY, 1.0)
    assert np.array_equal(surface.data, uneven().z.T, equal_nan=True)


def test_a_map_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "map.sdf").write_text("before")
    monkeypatch.setattr(sdfio, "write", fail)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path / "map.sdf", uneven(), "sdf")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]
