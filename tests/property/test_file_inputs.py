"""Files of unknown origin (mapping, scenario, DBC, height map) are read, or refused with a message."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sdfio
import tifffile
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from inkloop.errors import HeightMapError, ScenarioError
from inkloop.metrology.map_file import read
from inkloop.scenario.file import Scenario
from inkloop.testing import job as small_job
from inkloop_hardware.errors import FrameError
from inkloop_hardware.mapped.mapping_file import load
from inkloop_hardware.protocol.codec import Codec
from support.benches import foreign_rig
from support.examples import examples
from support.places import ROOT
from support.verdicts import Verdicts

ONE_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(60))
JOB = small_job(6, 5)
VALUES = st.sampled_from(
    ["", "0", "{layer}", "{layer.real}", "{layer[0]}", "{0}", "{", "{nx:x}", "{job:04x}", "{job!r:>9}", "A5", "head",
     "um", -1, 0, 3, 1 << 70, 0.5, float("inf"), float("nan"), True, [], [1], {}, {"a": 1}, ["lamp"], "BUSY", "State"]
)  # fmt: skip


BENCH = {
    "interface": "slcan",
    "channel": "/dev/ttyACM0",
    "bitrate": 500_000,
    "options": {},
    "x": 1,
    "traffic_log": "traffic.blf",
    "cure_ms": 2.0,
    "loop_timeout_s": 1.0,
}
"""Values that the table of the bench takes; `x` is no key of it."""


@pytest.fixture
def verdicts() -> Iterator[Verdicts]:
    """Twice as many are taken, at least, as the simplest one of sixty; some are refused."""
    found = Verdicts()
    yield found
    found.check(1 / 30)


def places(table: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every key of nested tables and arrays."""
    keys = list(table) if isinstance(table, dict) else range(len(table)) if isinstance(table, list) else ()
    return [place for key in keys for place in ((*at, key), *places(table[key], (*at, key)))]


def changed(text: str, data: st.DataObject) -> str:
    """The TOML with some values replaced, some keys added and some left out."""
    table = tomllib.loads(text)
    for _ in range(data.draw(st.integers(0, 3))):
        *above, key = data.draw(st.sampled_from(places(table)))
        inner: Any = table
        for step in above:
            inner = inner[step]
        if isinstance(inner, dict) and data.draw(st.booleans()):
            key = data.draw(st.sampled_from([key, "odd key", "address", "unit"]))
        if data.draw(st.booleans()) and data.draw(st.booleans()):
            inner.pop(key, None) if isinstance(inner, dict) else inner.pop(key)
        else:
            kept = isinstance(inner, list) or key in inner
            value = data.draw(st.just(inner[key]) | VALUES if kept else VALUES)
            inner[key] = deepcopy(value)  # tables and arrays are altered in the next round
        if not places(table):
            break
    return tomlkit.dumps(table)


@ONE_FOLDER
@given(data=st.data())
def test_mapping_file_is_taken_or_refused_with_its_errors(
    data: st.DataObject, tmp_path: Path, verdicts: Verdicts
) -> None:
    (tmp_path / "rig.dbc").write_text(foreign_rig.DBC)
    path = tmp_path / "rig.toml"
    path.write_text(changed(foreign_rig.MAPPING, data), encoding="utf-8")
    with verdicts.count(ScenarioError):
        load(path, JOB)


@ONE_FOLDER
@given(
    data=st.data(),
    table=st.fixed_dictionaries({}, optional={key: st.just(right) | VALUES for key, right in BENCH.items()}),
)
def test_table_of_the_bench_is_taken_or_refused_with_its_errors(
    data: st.DataObject, table: dict[str, Any], tmp_path: Path, verdicts: Verdicts
) -> None:
    text = (ROOT / "scenarios" / "cylinder.toml").read_text(encoding="utf-8")
    path = tmp_path / "scenario.toml"
    path.write_text(text + "\n" + tomlkit.dumps({"bench": table}), encoding="utf-8")
    with verdicts.count(ScenarioError):
        Scenario.load(path)


def edited(data: st.DataObject, whole: bytes) -> bytes:
    """One byte altered at most; or cut off, and with some bytes altered, doubled or taken out."""
    found = bytearray(whole)
    if data.draw(st.booleans()):
        del found[data.draw(st.integers(0, len(whole)) | st.just(len(whole))) :]
    else:
        at = data.draw(st.integers(0, len(whole) - 1))
        found[at] = data.draw(st.just(found[at]) | st.sampled_from(list(b"0123456789 ,;x\n")))
        return bytes(found)
    for _ in range(data.draw(st.integers(0, 4))):
        at = data.draw(st.integers(0, max(0, len(found) - 1)))
        found[at : at + data.draw(st.integers(0, 2))] = data.draw(st.binary(max_size=3))
    return bytes(found)


@ONE_FOLDER
@given(data=st.data())
def test_dbc_is_taken_or_refused_with_a_message(data: st.DataObject, tmp_path: Path, verdicts: Verdicts) -> None:
    path = tmp_path / "rig.dbc"
    path.write_bytes(edited(data, foreign_rig.DBC.encode()))
    with verdicts.count(FrameError):
        Codec(path)


Z = np.array([[0.5, 1.5, -2.25], [3.0, np.nan, 4.125], [5.0, 6.5, 7.0], [8.0, 9.0, 1.0]])


def saved(save: Any, *given: Any, **named: Any) -> bytes:
    file = BytesIO()
    save(file, *given, **named)
    return file.getvalue()


def sdf_of(form: sdfio.FileFormat) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        sdfio.write(Path(folder) / "map.sdf", Z * 1e-6, x_scale=5e-6, y_scale=4e-6, z_scale=1e-12, format=form)
        return (Path(folder) / "map.sdf").read_bytes()


MAPS = {
    "table.csv": b"dx [um];5,0\ndy [um];4,0\nHeight [um]\n0,5;1,5;BAD\n3,0;;4,125\n",
    "table.txt": b"# dx = 5 um\n# dy = 4 um\n# unit: um\n1 2 3\n4 5 nan\n",
    "array.npy": saved(np.save, Z),
    "arrays.npz": saved(np.savez, z_um=Z, dx_um=5.0, dy_um=4.0),
    "imagej.tif": saved(
        tifffile.imwrite, Z.astype(np.float32), imagej=True, resolution=(0.2, 0.25), metadata={"unit": "um"}
    ),
    "ome.tif": saved(
        tifffile.imwrite, Z.astype(np.float32), ome=True, metadata={"PhysicalSizeX": 5.0, "PhysicalSizeY": 4.0}
    ),
    "binary.sdf": sdf_of(sdfio.FileFormat.BINARY),
    "text.sdf": sdf_of(sdfio.FileFormat.ASCII),
}


@ONE_FOLDER
@given(data=st.data())
@pytest.mark.parametrize("name", MAPS)
def test_height_map_is_read_or_refused_with_a_message(
    data: st.DataObject, name: str, tmp_path: Path, verdicts: Verdicts
) -> None:
    path = tmp_path / name
    path.write_bytes(edited(data, MAPS[name]))
    # the first unit and the first pixel make the file readable
    unit = ("um", None) if name in ("array.npy", "imagej.tif", "ome.tif") else (None, "um")
    pixel = (5e-6, None) if name == "array.npy" else (None, 5e-6)
    chosen = data.draw(st.just((unit[0], pixel[0])) | st.tuples(st.sampled_from(unit), st.sampled_from(pixel)))
    with verdicts.count(HeightMapError):
        read(path, unit=chosen[0], pixel=chosen[1])
