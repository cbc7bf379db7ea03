"""Files of parts of unknown origin are read, or refused with a message; what is read becomes columns or a message."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from inkloop.component import Ink
from inkloop.errors import GeometryError
from inkloop.exchange.layers import BITMAP_FORMATS, archive, bitmap
from inkloop.exchange.layers.patterns import Patterns
from inkloop.geometry import Columns, load
from inkloop.tables.part_images import StackTable
from inkloop.tables.part_layers import LayersTable
from inkloop.tables.schema import Process
from inkloop.tables.shapes import Grid
from inkloop.tables.solid import PartError
from support import meshes
from support.examples import examples
from support.three_mf import mesh_object, model_xml, package

GRID = Grid(nx=14, ny=12, pitch_um=100.0)
BOX = meshes.box((1.0, 2.0, 0.5), (3.5, 4.25, 1.5))
FILES = {
    "box.stl": meshes.binary_stl(BOX),
    "text.stl": meshes.ascii_stl(BOX),
    "box.ply": meshes.ply(BOX),
    "box.obj": meshes.obj(BOX),
    "box.3mf": package(model_xml(mesh_object(2, BOX, "box"), '<item objectid="2"/>')),
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
EDITS = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), st.sampled_from(WORDS)), max_size=4)


@pytest.mark.parametrize("name", FILES)
def test_altered_mesh_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    if name.endswith(".3mf") and importlib.util.find_spec("lib3mf") is None:
        pytest.skip("lib3mf is not installed")
    path = tmp_path / name
    refusals = refusals_of(path, FILES[name], lambda: load(path, 12, 12, 0.5e-3, unit="mm"), GeometryError)
    assert all(refusal.startswith(str(path)) for refusal in refusals)


@pytest.mark.parametrize("form", [*BITMAP_FORMATS, "json"])
def test_altered_slices_and_manifests_are_read_or_refused(form: str, tmp_path: Path) -> None:
    """A picture as a slice, and the manifest of a folder of layers."""
    sites = np.random.default_rng(1).random((2, 9, 11)) < 0.6
    patterns = Patterns("test", "", 1e-4, (Ink(),), Process(), sites.astype(np.int8))
    archive.write(patterns, tmp_path / "out", form="png", layers=[1, 2])
    table: StackTable | LayersTable = LayersTable(shape="layers", file="out/manifest.json")
    path, content = tmp_path / "out" / "manifest.json", (tmp_path / "out" / "manifest.json").read_bytes()
    if form in BITMAP_FORMATS:
        path, content = tmp_path / "slice", bitmap.encode(sites[0], 1e-4, form, "slice")
        table = StackTable(shape="stack", files="slice", layer_um=8.0, pixel_um=100.0)
    refusals = refusals_of(path, content, lambda: table.solid(GRID, tmp_path).shape, PartError)
    assert all(path.name in refusal for refusal in refusals)


def refusals_of(path: Path, content: bytes, make: Callable[[], object], refusal: type[Exception]) -> list[str]:
    """Bytes cut out and put in; one file in thirty at least is read, and some are refused, by these messages."""
    taken, refusals = 0, list[str]()

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(80))
    @given(edits=EDITS, length=st.none() | st.floats(0, 1))
    def check(edits: list[tuple[float, int, bytes]], length: float | None) -> None:
        nonlocal taken
        data = content
        for place, cut, word in edits:
            at = int(place * len(data))
            data = data[:at] + word + data[at + cut :]
        if length is not None:
            data = data[: int(length * len(data))]
        path.write_bytes(data)
        try:
            columns = make()
        except refusal as error:
            refusals.append(str(error))
        else:
            assert isinstance(columns, Columns)
            taken += 1

    check()
    assert min(taken, len(refusals)) >= (taken + len(refusals)) / 30
    return refusals
