"""Files of parts of unknown origin are read, or refused with a message; what is read becomes columns or a message."""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Callable
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from inkloop.component import Ink
from inkloop.errors import GeometryError
from inkloop.exchange.layers import BITMAP_FORMATS, archive, bitmap
from inkloop.exchange.layers.patterns import Patterns
from inkloop.geometry import Columns, load
from inkloop.limits import KIB, MIB
from inkloop.tables.part_images import StackTable
from inkloop.tables.part_layers import LayersTable
from inkloop.tables.schema import Process
from inkloop.tables.shapes import Grid, PartError
from support import meshes
from support.examples import examples
from support.long_proofs import rest_is_long
from support.three_mf import mesh_object, model_xml, package

MEMORY_MAX = 256 * MIB
"""More than the libraries and a picture of 2^24 pixels take."""
GRID = Grid(nx=14, ny=12, pitch_um=100.0)
BOX = meshes.box((1.0, 2.0, 0.5), (3.5, 4.25, 1.5))
MODEL = model_xml(mesh_object(2, BOX, "box"), '<item objectid="2"/>').encode()
COUNTS = rest_is_long([80, 800], 1)
"""Examples of a test."""
FILES = {
    "box.stl": meshes.binary_stl(BOX),
    "text.stl": meshes.ascii_stl(BOX),
    "box.ply": meshes.ply(BOX),
    "binary.ply": meshes.binary_ply(BOX),
    "box.obj": meshes.obj(BOX),
    "box.3mf": package(MODEL),
    "model.3mf": MODEL,
}
WORDS = [
    b"",
    b"0",
    b"-1",
    b"1e308",
    b"nan",
    b"4294967295",
    b"\xff\xff\xff\xff",
    b"\0",
    b"\n",
    b" ",
    b"3",
    b"f 1 2",
    b"<a>",
]
LABELS = np.random.default_rng(1).integers(0, 3, (9, 11)).astype(np.uint8)
EDIT = st.tuples(st.floats(0, 1), st.integers(0, 12), st.sampled_from(WORDS))
FLIP = st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7))
CUT = st.sampled_from([False, False, False, True]).flatmap(lambda is_cut: st.floats(0, 1) if is_cut else st.none())
"""The share of a file that is left: all of most files, for hardly a picture is read without its end."""
CHANGES = 3
"""Of one sort in a file, at most."""


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", FILES)
def test_altered_mesh_files_are_read_or_refused(name: str, count: int, tmp_path: Path) -> None:
    """Of 3MF the model is altered, then packed; a package has checksums, which see nearly every change."""
    if name.endswith(".3mf") and importlib.util.find_spec("lib3mf") is None:
        pytest.skip("lib3mf is not installed")
    path = tmp_path / name
    packed = package if name == "model.3mf" else bytes
    refusals = refusals_of(
        lambda data: path.write_bytes(packed(data)),
        FILES[name],
        lambda: load(path, 12, 12, 0.5e-3, unit="mm"),
        GeometryError,
        count,
        changes=1 if name == "box.3mf" else CHANGES,
        taken_min=1 / 200 if name == "box.3mf" else 1 / 30,
    )
    assert not [refusal for refusal in refusals if not refusal.startswith(str(path))]


def picture(form: str, mode: str, **options: Any) -> bytes:
    """A picture of labels, as Pillow writes it."""
    file = io.BytesIO()
    image = Image.fromarray(LABELS.astype(np.uint16) if mode == "I;16" else LABELS)
    if mode == "P":
        image.putpalette([0, 0, 0, 255, 0, 0, 0, 0, 255])
    elif mode != "I;16":
        image = image.convert(mode)
    image.save(file, form, **options)
    return file.getvalue()


PICTURES = {
    "grey.png": picture("PNG", "L"),
    "opaque.png": picture("PNG", "RGBA"),
    "deep.png": picture("PNG", "I;16"),
    "palette.png": picture("PNG", "P", bits=2, transparency=0),
    "grey.bmp": picture("BMP", "L"),
    "palette.bmp": picture("BMP", "P"),
    "deep.tif": picture("TIFF", "I;16"),
    "packed.tif": picture("TIFF", "L", compression="tiff_lzw"),
    "pages.tif": picture("TIFF", "P", save_all=True, append_images=[Image.fromarray(LABELS)]),
}


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", PICTURES)
def test_altered_pictures_are_read_or_refused(name: str, count: int, tmp_path: Path) -> None:
    path = tmp_path / name
    table = StackTable(shape="stack", files=name, layer_um=8.0, pixel_um=100.0)
    write, content = path.write_bytes, PICTURES[name]
    changes = 1 if name.endswith(".tif") else CHANGES  # of a stream of bits or offsets, most leave nothing
    refusals = refusals_of(write, content, lambda: table.solid(GRID, tmp_path).shape, PartError, count, changes)
    assert not [refusal for refusal in refusals if "files" not in refusal and "inks" not in refusal]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("form", [*BITMAP_FORMATS, "json"])
def test_altered_slices_and_manifests_are_read_or_refused(form: str, count: int, tmp_path: Path) -> None:
    """A picture as a slice, and the manifest of a folder of layers."""
    sites = np.random.default_rng(1).random((2, 9, 11)) < 0.6
    patterns = Patterns("test", "", 1e-4, (Ink(),), Process(), sites.astype(np.int8))
    archive.write(patterns, tmp_path / "out", form="png", layers=[1, 2])
    table: StackTable | LayersTable = LayersTable(shape="layers", file="out/manifest.json")
    path, content = tmp_path / "out" / "manifest.json", (tmp_path / "out" / "manifest.json").read_bytes()
    if form in BITMAP_FORMATS:
        path, content = tmp_path / "slice", bitmap.encode(sites[0], 1e-4, form, "slice")
        table = StackTable(shape="stack", files="slice", layer_um=8.0, pixel_um=100.0)
    refusals = refusals_of(path.write_bytes, content, lambda: table.solid(GRID, tmp_path).shape, PartError, count)
    assert not [refusal for refusal in refusals if path.name not in refusal]


def refusals_of(
    write: Callable[[bytes], object],
    content: bytes,
    make: Callable[[], object],
    refusal: type[Exception],
    count: int,
    changes: int = CHANGES,
    taken_min: float = 1 / 30,
) -> list[str]:
    """Bytes cut out, put in and bits turned; some files are refused, by these messages, and a share at least is read.

    Nothing takes much memory, whatever a count in the file says.
    """
    taken, refusals = 0, list[str]()

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(count))
    @given(
        edits=st.lists(EDIT, max_size=changes),
        flips=st.lists(FLIP, max_size=changes),
        length=CUT,
    )
    def check(edits: list[tuple[float, int, bytes]], flips: list[tuple[float, int]], length: float | None) -> None:
        nonlocal taken
        turned = bytearray(content)
        for place, bit in flips:
            turned[int(place * len(turned))] ^= 1 << bit
        data = bytes(turned)
        for place, cut, word in edits:
            at = int(place * len(data))
            data = data[:at] + word + data[at + cut :]
        if length is not None:
            data = data[: int(length * len(data))]
        write(data)
        try:
            columns = make()
        except refusal as error:
            refusals.append(str(error))
        else:
            assert isinstance(columns, Columns)
            taken += 1

    before = getrusage(RUSAGE_SELF).ru_maxrss
    check()
    assert (getrusage(RUSAGE_SELF).ru_maxrss - before) * KIB < MEMORY_MAX
    assert min(taken, len(refusals)) >= taken_min * (taken + len(refusals))
    return refusals
