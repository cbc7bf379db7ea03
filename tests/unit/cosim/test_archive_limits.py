"""Archives and maps that would fill disk or memory are refused before they are unpacked."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from inkloop import limits
from inkloop.errors import FmuError, HeightMapError, InkloopError, ScenarioError
from inkloop.exchange.ssp.reading import scenario_of
from inkloop.fmu import FmuComponent, archive_error, describe
from inkloop.fmu.archive_member import fmu_file
from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import find_fmu
from inkloop.limits import MIB
from inkloop.metrology import map_file


@pytest.fixture
def bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One of our FMUs with 4 MiB of zeros; to try it cheaply, 1 MiB counts as much as a packed archive may hold."""
    monkeypatch.setattr(limits, "PLAIN_SIZE", MIB)
    monkeypatch.setattr(limits, "PACKED_AT_MOST", 3)
    path = tmp_path / "bomb.fmu"
    with zipfile.ZipFile(find_fmu("ProfileSensor")) as ours, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for name in ours.namelist():
            made.writestr(name, ours.read(name))
        made.writestr("resources/zeros", bytes(4 * MIB))
    return path


def member_of(path: Path) -> None:
    with fmu_file(path):
        pass


def test_fmu_that_unpacks_to_too_much_is_refused_by_every_reader(bomb: Path) -> None:
    readers: list[Callable[[Path], object]] = [describe, FmuComponent, unpack]
    for reader in readers:
        with pytest.raises(FmuError, match=r"bomb\.fmu: unpacks to 4\.\d+ MiB, \d+ times its size"):
            reader(bomb)
    assert str(archive_error(bomb)).startswith("unpacks to")


def test_ssp_that_unpacks_to_too_much_is_refused(bomb: Path) -> None:
    path = bomb.rename(bomb.with_name("bomb.ssp"))
    with pytest.raises(ScenarioError, match="unpacks to 4"):
        scenario_of(path)
    with pytest.raises(InkloopError, match=r"bomb\.ssp: unpacks to 4"):
        member_of(path / "resources/zeros")


def test_description_that_memory_cannot_hold_is_not_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "available_memory", lambda: 10_000)
    path = find_fmu("LayerDeposition", "fmi2")
    path.touch()  # descriptions are kept
    with pytest.raises(FmuError, match=r"its modelDescription\.xml of .* needs about .* of memory, 9\.77 KiB are"):
        describe(path)


def test_npz_of_zeros_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "zeros.npz"
    np.savez_compressed(path, z_um=np.zeros((600, 600)), pixel_um=1.0)
    assert map_file.read(path).z.shape == (600, 600)
    monkeypatch.setattr(limits, "PLAIN_SIZE", MIB)
    with pytest.raises(HeightMapError, match=r"zeros\.npz: unpacks to 2\.75 MiB, \d+ times its size"):
        map_file.read(path)


@pytest.mark.parametrize("suffix", ["npy", "npz", "csv"])
def test_map_that_memory_cannot_hold_is_refused(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / f"map.{suffix}"
    values = np.random.default_rng(1).normal(size=(100, 100))
    {"npy": np.save, "npz": lambda file, array: np.savez(file, z=array)}.get(suffix, np.savetxt)(path, values)
    monkeypatch.setattr(limits, "available_memory", lambda: 100_000)
    with pytest.raises(HeightMapError, match=r"needs about .* of memory, 97\.7 KiB are available; save a part"):
        map_file.read(path, unit="um", pixel=1e-6)


def test_small_numbers_that_become_large_ones_are_counted_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An array of bytes takes eight times its size as heights."""
    file = io.BytesIO()
    np.save(file, np.arange(10_000, dtype=np.uint8).reshape(100, 100))
    (tmp_path / "map.npy").write_bytes(file.getvalue())
    monkeypatch.setattr(limits, "available_memory", lambda: 100_000)
    with pytest.raises(HeightMapError, match="holds 10,000 pixels: needs about 156 KiB of memory"):
        map_file.read(tmp_path / "map.npy", unit="um", pixel=1e-6, scale=1.0)
