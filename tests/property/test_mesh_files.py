"""Mesh files of unknown origin are read, or refused with a message; what is read becomes columns or a message."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from inkloop.errors import GeometryError
from inkloop.geometry import Columns, load
from support import meshes
from support.examples import examples
from support.three_mf import mesh_object, model_xml, package

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
    """Bytes cut out and put in; one file in thirty at least is read, and some are refused."""
    if name.endswith(".3mf") and importlib.util.find_spec("lib3mf") is None:
        pytest.skip("lib3mf is not installed")
    taken, refusals = 0, []

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(80))
    @given(edits=EDITS, length=st.none() | st.floats(0, 1))
    def check(edits: list[tuple[float, int, bytes]], length: float | None) -> None:
        nonlocal taken
        data = FILES[name]
        for place, cut, word in edits:
            at = int(place * len(data))
            data = data[:at] + word + data[at + cut :]
        if length is not None:
            data = data[: int(length * len(data))]
        path = tmp_path / name
        path.write_bytes(data)
        try:
            columns = load(path, 12, 12, 0.5e-3, unit="mm")
        except GeometryError as error:
            refusals.append(str(error))
        else:
            assert isinstance(columns, Columns)
            taken += 1

    check()
    assert min(taken, len(refusals)) >= (taken + len(refusals)) / 30
    assert all(refusal.startswith(str(tmp_path / name)) for refusal in refusals)
