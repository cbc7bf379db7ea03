"""The job of a block is read from its resources: any path, any file, and a message for an invalid one."""

from __future__ import annotations

import ctypes
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy import fmi3

from inkloop.fmu_writer import definition
from support import compiled
from support.fmus.fmu_driver import OK, Driver
from support.fmus.layer_jobs import CUBOID, MODEL, finish, unpacked
from support.places import ROOT

EXTREMES = (0, 1, 2**31, 2**53, 2**63, 2**64 - 1, 0x7FF8000000000000, 0xFFF0000000000000, 0xBFF0000000000000)
HEAD, SECTION = 32, 56


class Binary:
    """The FMI 3 block of a scenario as far as its instantiation, with any folder of resources."""

    def __init__(self) -> None:
        folder = unpacked("fmi3-fixed", "cuboid", *CUBOID)
        self.token = fmpy.read_model_description(folder).instantiationToken
        self.content = (folder / "resources" / "job.bin").read_bytes()
        found = next((folder / "binaries").rglob(f"{MODEL}*"))
        self._library = ctypes.CDLL(str(found))
        self._library.fmi3InstantiateCoSimulation.restype = ctypes.c_void_p

    def refusal(self, resources: str | None, token: str | None = None) -> str | None:
        """The log if no instance is made; None if one is."""
        logged: list[str] = []
        log = fmi3.fmi3LogMessageCallback(
            lambda _, status, category, text: logged.append(text.decode("utf-8", "replace"))
        )
        own_token, place = (token or self.token).encode(), None if resources is None else resources.encode()
        flags, no_values = [ctypes.c_bool(False)] * 4, (None, ctypes.c_size_t(0))
        create = self._library.fmi3InstantiateCoSimulation
        instance = create(b"it", own_token, place, *flags, *no_values, None, log, None)
        if not instance:
            (message,) = logged
            return message
        self._library.fmi3FreeInstance(ctypes.c_void_p(instance))
        return None

    def refusal_of(self, content: bytes, folder: Path, *, token: str | None = None) -> str | None:
        """The same for a file of some content."""
        (folder / "job.bin").write_bytes(content)
        return self.refusal(str(folder), token)

    @property
    def unmarked(self) -> str:
        """A token that does not name its file, so that only the content of the file can be wrong."""
        return self.token.rpartition("-")[0]


@pytest.fixture(scope="module")
def binary() -> Binary:
    return Binary()


def summed(content: bytes | bytearray) -> bytes:
    """With the check sum that belongs to it."""
    return bytes(content[:12]) + struct.pack("<I", zlib.crc32(content[16:])) + bytes(content[16:])


def changed(content: bytes, at: int, value: bytes) -> bytes:
    return content[:at] + value + content[at + len(value) :]


def test_file_as_it_was_written_is_taken(binary, tmp_path) -> None:
    assert binary.refusal_of(binary.content, tmp_path) is None
    assert binary.refusal(f"{tmp_path}/") is None
    assert binary.refusal_of(summed(binary.content), tmp_path, token=binary.unmarked) is None


def with_value(content: bytes, name: str, value: float) -> bytes:
    """Another value of a parameter of the block or of its controller."""
    models = ["LayerJob", "", "", "LayerController"]
    numbers = [{v.name: k for k, v in enumerate(variables_of(model))} if model else {} for model in models]
    at = HEAD
    for known in numbers:
        (count,) = struct.unpack_from("<Q", content, at + SECTION - 8)
        at += SECTION
        for _ in range(count):
            number, size = struct.unpack_from("<QQ", content, at)
            if number == known.get(name):
                return changed(content, at + 16, struct.pack("<d", value))
            at += 16 + 8 * size
    raise AssertionError(name)


def variables_of(model: str) -> Any:
    folder = {"LayerJob": "layer_job", "LayerController": "layer_controller"}[model]
    return definition.load((ROOT / "fmus" / folder / "variables.toml").read_text(), "").exposed


FAULTS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "empty": (lambda c: b"", "it does not begin as one"),
    "of others": (lambda c: b"PK\x03\x04" + c, "it does not begin as one"),
    "in text mode": (lambda c: c.replace(b"\r\n", b"\n"), "it does not begin as one"),
    "cut": (lambda c: c[:-9], "its check sum is another one"),
    "of a later layout": (lambda c: changed(c, 8, b"\x02"), "is of layout 2; this binary reads layout 1"),
    "damaged": (lambda c: changed(c, 700, b"\xff"), "its check sum is another one"),
    "of another export": (lambda c: summed(changed(c, len(c) - 8, struct.pack("<d", 1e-9))), "belong to different"),
    "of another grid": (lambda c: summed(changed(c, 16, b"\x0d")), "is for 13 x 12 cells, the FMU for 12 x 12"),
    "of another grid along y": (lambda c: summed(changed(c, 24, b"\x0d")), "is for 12 x 13 cells, the FMU for 12 x 12"),
    "of another model": (lambda c: summed(changed(c, HEAD, b"LayerJib")), "LayerJib"),
    "a part of a number": (lambda c: summed(with_value(c, "layers_max", 2.5)), "a value is not of the type"),
    "more than an integer holds": (
        lambda c: summed(with_value(c, "layers_max", 2.0**31)),
        "a value is not of the type",
    ),
    "no boolean": (lambda c: summed(with_value(c, "flat_ground", 2.0)), "a value is not of the type"),
    "of other variables": (lambda c: summed(changed(c, HEAD + 32, b"0123456789abcdef")), "variables 0123456789abcdef"),
    "of a plant of others": (
        lambda c: summed(c.replace(b"LayerDeposition", b"LaserDeposition")),
        "has a printer LaserDeposition, which this binary does not know",
    ),
    "longer": (lambda c: summed(c + bytes(8)), "its sections do not fill it"),
    "a section short": (lambda c: summed(c[: c.index(b"LayerController")]), "its sections do not fill it"),
    "two values of a number": (
        lambda c: summed(changed(c, HEAD + SECTION + 8, struct.pack("<Q", 2))),
        "a parameter has the wrong number or size",
    ),
    "a value out of range": (
        lambda c: summed(changed(c, HEAD + SECTION + 16, struct.pack("<d", -1.0))),
        "layer_period is -1; expected a finite number not below 1e-06",
    ),
}


@pytest.mark.parametrize("error", FAULTS)
def test_file_that_is_not_the_blocks_own_is_refused_with_a_message(error, binary, tmp_path) -> None:
    spoil, words = FAULTS[error]
    token = None if "export" in error else binary.unmarked
    message = binary.refusal_of(spoil(binary.content), tmp_path, token=token)
    assert message is not None
    assert words in message


def test_missing_file_and_missing_folder_are_reported(binary, tmp_path) -> None:
    assert "job.bin cannot be read: No such file" in binary.refusal(str(tmp_path))
    assert "inkloop export job" in binary.refusal(str(tmp_path))
    assert "the importer names no folder of resources" in binary.refusal(None)
    (tmp_path / "job.bin").mkdir()
    assert "cannot be read" in binary.refusal(str(tmp_path))


def test_no_cut_file_is_taken(binary, tmp_path) -> None:
    for size in range(0, len(binary.content), 7):
        assert binary.refusal_of(binary.content[:size], tmp_path, token=binary.unmarked) is not None
        if size >= HEAD:
            cut = summed(binary.content[:size])
            assert "its sections do not fill it" in binary.refusal_of(cut, tmp_path, token=binary.unmarked)


def test_any_word_and_any_bytes_of_the_file_may_be_anything(binary, tmp_path) -> None:
    """An instance or a message: a check sum protects from accidents only."""
    refused, random = 0, np.random.default_rng(1)
    for number, at in enumerate(range(16, len(binary.content) - 7, 8)):
        for extreme in EXTREMES if number < 40 else EXTREMES[number % len(EXTREMES) :][:1]:
            content = summed(changed(binary.content, at, struct.pack("<Q", extreme)))
            message = binary.refusal_of(content, tmp_path, token=binary.unmarked)
            refused += message is not None
            assert message is None or len(message) > 20
    assert refused > 100
    for _ in range(500):
        spoilt = bytearray(binary.content)
        for _ in range(random.integers(1, 12)):
            spoilt[random.integers(16, len(spoilt))] = random.integers(256)
        binary.refusal_of(summed(spoilt), tmp_path, token=binary.unmarked)


@pytest.mark.parametrize("form", ["fmi2", "fmi3-fixed"])
def test_folder_with_any_name_is_found(form, tmp_path) -> None:
    """FMI 2 names it by a URI, in which each of these characters is written otherwise."""
    folder = tmp_path / "50%20 grün #1"
    shutil.copytree(unpacked(form, "cuboid", *CUBOID), folder)
    with Driver(MODEL, form, folder=folder) as fmu:
        finish(fmu.start(), 1.0)


URIS = {
    "file:///a%20b/100%25/resources": "/a b/100%/resources",
    "file:/a/resources": "/a/resources",
    "file://localhost/a/resources": "/a/resources",
    "FILE:///a/gr%C3%BCn": "/a/grün",
    "file:///C:/a%20b/resources": "C:/a b/resources",
    "file:/C:/a/resources": "C:/a/resources",
    "file://server/share/resources": "//server/share/resources",
    "/a b/100%/resources": "/a b/100%/resources",
    "C:\\a\\resources": "C:\\a\\resources",
    "file:///a%2": "/a%2",
    "file:": "",
    "": "",
}


@pytest.mark.compiled
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_uri_of_a_folder_becomes_its_path() -> None:
    function = compiled.library("resources.so", [ROOT / "fmus/common/resources.c"], ("-std=c11",)).resource_path
    function.restype = ctypes.c_char_p
    assert {uri: function(uri.encode()).decode() for uri in URIS} == URIS


def test_instance_is_reset_only_while_its_file_is_there(tmp_path) -> None:
    shutil.copytree(unpacked("fmi3-fixed", "cuboid", *CUBOID), tmp_path / "it")
    with Driver(MODEL, "fmi3-fixed", folder=tmp_path / "it") as fmu:
        assert fmu.start().step(0.0, 2.5) == OK
        before = fmu.save()
        (tmp_path / "it" / "resources" / "job.bin").unlink()
        assert fmu.call("reset") != OK
        assert "cannot be read" in fmu.messages[-1]
        assert fmu.save() == before
