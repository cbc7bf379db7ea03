"""Limits of the resources that input may request; the figures come from the system."""

from __future__ import annotations

import io
import re
import resource
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from inkloop import limits
from inkloop.errors import FmuError, HeightMapError, InkloopError, ResultError, ScenarioError
from inkloop.exchange.ssp.reading import scenario_of
from inkloop.files import TomlError, toml_tables
from inkloop.fmu import FmuComponent, archive_error, describe
from inkloop.fmu.reading import fmu_file
from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import find_fmu
from inkloop.limits import (
    GIB,
    KIB,
    MIB,
    XmlError,
    available_memory,
    duration_text,
    filled,
    free_disk,
    memory_error,
    parsed_xml,
    size_text,
    unpacked_error,
    usable_cores,
)
from inkloop.metrology import map_file
from inkloop.metrology.map_readers import read_instrument, read_tiff
from inkloop.results.result import read_record
from support.places import SCENARIOS
from support.source_tree import modules

FIELDS = {"layer": 7, "nx": 35}


@pytest.mark.parametrize(
    ("template", "text"),
    [("a", "a"), ("{layer}", "7"), ("{layer:04d}-{nx:x}", "0007-23"), ("{layer:064b}", f"{7:064b}"), ("{{}}", "{}")],
)
def test_template_of_whole_numbers_is_filled(template: str, text: str) -> None:
    assert filled(template, FIELDS) == text


@pytest.mark.parametrize(
    "template",
    [
        *("{layer:999999999d}", "{layer:65d}", "{layer:.999999999f}", "{layer:{nx}}", "{layer!r:>999999999}"),
        *("{layer.__class__}", "{layer[0]}", "{lyer}", "{}", "{0}", "{", "}", "{layer:,}"),
    ],
)
def test_any_other_template_is_refused_before_it_is_filled(template: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 of `string.Formatter` for an open brace, of `filled` for the rest
        filled(template, FIELDS)


def archive(folder: Path, size: int, method: int) -> zipfile.ZipFile:
    """An archive whose one member has `size` zeros."""
    with zipfile.ZipFile(folder / "zeros.zip", "w", method) as made, made.open("zeros", "w", force_zip64=True) as file:
        for _ in range(size // MIB):
            file.write(bytes(MIB))
    return zipfile.ZipFile(folder / "zeros.zip")


def test_archive_may_unpack_to_much_or_be_packed_tightly_but_not_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with archive(tmp_path, 4 * MIB, zipfile.ZIP_DEFLATED) as tight:
        assert unpacked_error(tight) is None
        monkeypatch.setattr(limits, "PLAIN_SIZE", MIB)
        error = unpacked_error(tight)
    assert error is not None
    assert error.startswith("unpacks to 4 MiB, 10")  # deflate makes 1000 zeros one byte
    assert "at most 200 times are taken" in error
    with archive(tmp_path, 4 * MIB, zipfile.ZIP_STORED) as large:
        for most in (limits.UNPACKED_MAX, 4 * MIB):
            monkeypatch.setattr(limits, "UNPACKED_MAX", most)
            assert unpacked_error(large) is None
        monkeypatch.setattr(limits, "UNPACKED_MAX", MIB)
        assert unpacked_error(large) == "unpacks to 4 MiB; at most 1 MiB are taken"


def system(folder: Path, monkeypatch: pytest.MonkeyPatch, **files: str) -> None:
    """A machine whose files of the system are these."""
    for name, text in {"meminfo": "MemTotal: 9000 kB\nMemAvailable: 8000 kB\n", **files}.items():
        path = folder / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(limits, "_PROC", folder)
    monkeypatch.setattr(limits, "_CGROUP", folder / "cgroup")


def test_memory_is_what_the_system_has_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    system(tmp_path, monkeypatch)
    assert available_memory() == 8000 * KIB
    assert memory_error(8000 * KIB) is None
    assert memory_error(8001 * KIB) == "needs about 7.81 MiB of memory, 7.81 MiB are available"


def test_memory_is_what_a_container_and_those_around_it_leave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limit = {"cgroup__box__memory.max": "5000", "cgroup__box__memory.current": "3000"}
    cache = {"cgroup__box__memory.stat": "anon 2500\ninactive_file 400\n", "cgroup__box__job__memory.max": "max\n"}
    system(tmp_path, monkeypatch, self__cgroup="0::/box/job\n", **limit, **cache)
    assert available_memory() == 5000 - 3000 + 400
    (tmp_path / "memory.max").write_text("10")  # beyond the outermost group
    (tmp_path / "memory.current").write_text("0")
    assert available_memory() == 5000 - 3000 + 400
    (tmp_path / "cgroup/box/memory.max").write_text("2000")
    assert available_memory() == 0


def test_memory_is_what_the_limit_of_the_address_space_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 1000 pages the program has 600, of which 20 are in memory."""
    system(tmp_path, monkeypatch, self__statm="600 20 5 1 0 30 0\n")
    page = resource.getpagesize()
    monkeypatch.setattr(resource, "getrlimit", lambda what: (1000 * page, -1) if what == resource.RLIMIT_AS else (1, 1))
    assert available_memory() == 400 * page


@pytest.mark.parametrize(("limit", "most"), [("0", 1), ("1", 1), ("1000000", None), ("many", None), ("", None)])
def test_threads_are_as_many_as_the_environment_says_and_at_least_one(
    limit: str, most: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    cores = usable_cores()
    monkeypatch.setenv("OMP_NUM_THREADS", limit)
    assert usable_cores() == (most or cores)


def test_free_disk_of_a_folder_to_be_made_is_that_of_its_place(tmp_path: Path) -> None:
    found, here = free_disk(tmp_path / "runs" / "new"), free_disk(tmp_path)
    assert found is not None
    assert here is not None
    assert abs(found - here) < GIB
    assert abs(found - shutil.disk_usage(tmp_path).free) < GIB


@pytest.mark.parametrize(
    ("count", "text"),
    [
        *(
            (500, "0.488 KiB"),
            (2000, "1.95 KiB"),
            (1023.6 * KIB, "1,024 KiB"),
            (3 * MIB, "3 MiB"),
            (1000 * MIB, "1,000 MiB"),
        ),
        *((1.5 * GIB, "1.5 GiB"), (1e18, "909,495 TiB")),
    ],
)
def test_size_is_written_for_a_person(count: float, text: str) -> None:
    assert size_text(count) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.142, "0.142 s"), (119, "119 s"), (120, "2 min"), (7000, "117 min"), (7200, "2 h"), (9000, "2.5 h"),
     (1e7, "2,778 h"), (1e9, "277,778 h")],
)  # fmt: skip
def test_time_is_written_for_a_person(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


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


DOCUMENT_TYPES = (
    '<!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;&b;">]>',
    '<!-- a --><!DOCTYPE a SYSTEM "http://127.0.0.1:1/a.dtd">',
    "<!DOCTYPE a>",
)


def package(path: Path, **members: str | bytes) -> Path:
    with zipfile.ZipFile(path, "w") as packed:
        for name, content in members.items():
            packed.writestr(name.replace("__", "/").replace("_", "."), content)
    return path


def described_picture(path: Path, text: str) -> Path:
    namespace = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
    tifffile.imwrite(path, np.zeros((2, 3), np.float32), description=f'{text}<OME xmlns="{namespace}"/>', metadata=None)
    return path


@pytest.mark.parametrize("text", DOCUMENT_TYPES)
@pytest.mark.parametrize(
    "read",
    [
        lambda folder, text: parsed_xml(f"{text}<a/>"),
        lambda folder, text: parsed_xml(f"{text}<a/>".encode("utf-16")),
        lambda folder, text: describe(package(folder / "a.fmu", modelDescription_xml=f"{text}<a/>")),
        lambda folder, text: describe(
            package(folder / "a.fmu", modelDescription_xml="<a/>", sources__buildDescription_xml=f"{text}<a/>")
        ),
        lambda folder, text: scenario_of(
            package(folder / "a.ssp", SystemStructure_ssd=f"{text}<a/>"), job=SCENARIOS / "cuboid.toml"
        ),
        lambda folder, text: read_instrument(package(folder / "a.x3p", main_xml=f"{text}<a/>")),
        lambda folder, text: read_tiff(described_picture(folder / "a.tif", text)),
    ],
)
def test_document_types_are_refused_in_xml_of_any_file(
    read: Callable[[Path, str], Any], text: str, tmp_path: Path
) -> None:
    with pytest.raises((XmlError, InkloopError), match="declares a document type \\(DOCTYPE\\), which is not read"):
        read(tmp_path, text)


def test_xml_is_parsed_where_document_types_are_refused_before() -> None:
    """In what is written here too: descriptions of our own FMUs, and of those that `describe` has read."""
    checked = {
        "limits",
        "fmu.reading",
        "geometry.three_mf",
        "fmu_writer.export",
        "exchange.ssp.folder",
    }
    parsers = re.compile(r"\b(fromstring|iterparse|XMLParser|XMLPullParser|ParserCreate|minidom|lxml|etree\.parse)\b")
    found = {name for name, path in modules().items() if parsers.search(path.read_text(encoding="utf-8"))}
    assert found == {f"inkloop.{name}" for name in checked}


@pytest.mark.parametrize(
    ("members", "message"),
    [
        (["a", "b"] * 2, "holds 'b' twice, with other contents"),
        (["a/", "a/a", "a/", "a", "a"], "None"),
        ([str(number) for number in range(limits.MEMBERS_MAX + 1)], "holds 65,536 members; at most 65,535 are taken"),
    ],
)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_archives_that_readers_take_differently_or_never_end_are_refused(
    members: list[str], message: str, tmp_path: Path
) -> None:
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as packed:
        for number, name in enumerate(members):
            packed.writestr(name, str(number) if name == "b" else "")
    with zipfile.ZipFile(tmp_path / "a.fmu") as packed:
        assert message in str(unpacked_error(packed))


@pytest.mark.parametrize("text", ["a = " + "[" * 20_000, "a = " + "9" * 5_000])
def test_texts_that_python_refuses_to_parse_are_errors_of_the_file(text: str, tmp_path: Path) -> None:
    with pytest.raises(TomlError, match="is not TOML that can be read: "):
        toml_tables(text)
    (tmp_path / "run.json").write_text(text.removeprefix("a = "))
    with pytest.raises(ResultError, match=f"{tmp_path}: cannot be read: "):
        read_record(tmp_path)
