"""Limits of the resources that input may request; the figures come from the system."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from inkloop import limits
from inkloop.limits import GIB, KIB, MIB, available_memory, filled, free_disk, memory_error, size_text, unpacked_error

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


def test_free_disk_of_a_folder_to_be_made_is_that_of_its_place(tmp_path: Path) -> None:
    found, here = free_disk(tmp_path / "runs" / "new"), free_disk(tmp_path)
    assert found is not None
    assert here is not None
    assert abs(found - here) < GIB


@pytest.mark.parametrize(
    ("count", "text"), [(2000, "1.95 KiB"), (3 * MIB, "3 MiB"), (1.5 * GIB, "1.5 GiB"), (1e18, "909,495 TiB")]
)
def test_size_is_written_for_a_person(count: float, text: str) -> None:
    assert size_text(count) == text
