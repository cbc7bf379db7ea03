"""Every key of the tables takes the numbers between its limits and no others, and has the default of its page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from inkloop.bench.commands import emulation_of
from inkloop.component import Ink
from inkloop.components.port_tables import PortTable
from inkloop.components.shadow_kind import ShadowTable
from inkloop.errors import InkloopError, ScenarioError
from inkloop.metrology.evaluation.definitions import Evaluation, Treatment
from inkloop.scenario.file import Scenario
from inkloop.tables import schema
from inkloop.tables.bench_faults import FaultTable, read_fault
from inkloop.tables.ink_file import DropletTable
from inkloop.tables.metrology import MetrologyTable
from inkloop.tables.part_images import StackTable
from inkloop.tables.part_layers import Manifest, ManifestFile, ManifestInk
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.shapes import CylinderTable, Grid, StaircaseTable, SubstrateTable
from inkloop.units import M_PER_UM
from inkloop_lab.identify.log_folder import PrintTable
from support.benches.bench_run import BLOCK, write

TINY = 5e-324
POSITIVE = ([TINY, 1e9], [0.0, -1.0, math.inf, math.nan])
NOT_NEGATIVE = ([0.0, 1e9], [-TINY, math.inf, math.nan])
FINITE = ([0.0, -1e9, 1e9], [math.inf, -math.inf, math.nan])
COUNT = ([1, 10**6], [0, -1, 1.5, True])


def whole(least: int, most: int) -> tuple[list[Any], list[Any]]:
    return [least, most], [least - 1, most + 1, least + 0.5]


GRID = {"nx": 1, "ny": 1}
CYLINDER = {"shape": "cylinder", "radius_um": 1.0, "height_um": 1.0}
STAIRS = {"shape": "staircase", "size_x_um": 1.0, "size_y_um": 1.0, "steps": 1, "height_um": 1.0}
STACK = {"shape": "stack", "files": "x.tif", "layer_um": 1.0, "pixel_um": 1.0}
MESH = {"shape": "mesh", "file": "x.stl"}
PITCH = {"pitch_um": 1.0}
LOSS = {"kind": "loss"}
INKS = ([{"0123456789": "A"}], [{"01234567890": "A"}, {"-1": "A"}, {"": "A"}, {"a": "A"}, {"1": "C"}])
TURNS = ([[0.0, 90.0, -1e3]], [[0.0] * 2, [0.0] * 4, [math.inf, 0.0, 0.0]])
EVENT = {"action": "reset", "port": "a.b"}
FILE = {"file": "x.png", "layer": 1, "ink": "A", "sha256": ""}
MANIFEST = {
    "format": "inkloop layers", "format_version": 1, "width_pixels": 1, "height_pixels": 1, "pitch_x_um": 1.0,
    "pitch_y_um": 1.0, "origin": "", "first_row": "", "first_column": "", "polarity": "", "drop_levels": 1,
    "inks": {}, "files": [FILE],
}  # fmt: skip
SHARE = ([TINY, 1.0], [0.0, 1.0001, math.nan])
WORD = whole(1, 2**32 - 1)
LIMITS: list[tuple[type[BaseModel], dict[str, Any], dict[str, tuple[list[Any], list[Any]]]]] = [
    (Grid, GRID, {"nx ny": COUNT, "pitch_um": ([1.0, 1e4], [0.999, math.inf, math.nan])}),
    (CylinderTable, CYLINDER, {"radius_um height_um": POSITIVE, "center_x_um": FINITE}),
    (StaircaseTable, STAIRS, {"size_x_um size_y_um": POSITIVE, "steps": COUNT, "center_y_um": FINITE}),
    (StackTable, STACK, {"layer_um pixel_um": POSITIVE, "inks": INKS}),
    (MeshTable, MESH, {"rotate_deg": TURNS, "scale": POSITIVE}),
    (
        SubstrateTable,
        {},
        {"tilt_x tilt_y step_um": FINITE, "wave_um roughness_um": NOT_NEGATIVE, "wavelength_um": POSITIVE},
    ),
    (schema.Support, {}, {"margin_cells": ([0, 9], [-1, 0.5])}),
    (schema.InkTable, {}, {"h1_um": ([TINY, 1e3], [0.0, 1e3 + 1e-9, math.inf, math.nan])}),
    (schema.InkTable, {}, {"h2_um h3_um": ([0.0, 1e3], [-TINY, 1e3 + 1e-9, math.inf, math.nan])}),
    (DropletTable, {"h1_um": 1.0, "h2_um": 1.0, "h3_um": 1.0}, {"h1_um": POSITIVE, "h2_um h3_um": NOT_NEGATIVE}),
    (schema.Process, {}, {"passes": ([1, 4], [0, 2, 5]), "pass_rotation": whole(0, 3)}),
    (schema.BenchTable, {}, {"bitrate": whole(10_000, 1_000_000), "data_bitrate": whole(10_000, 8_000_000)}),
    (schema.BenchTable, {}, {"traffic_log": (["", "a.blf", "b.asc"], ["x/a.blf", "x\\a.blf", "a.log", ".blf"])}),
    (schema.BenchTable, {}, {"cure_ms": whole(1, 65534), "loop_timeout_s grace_s answer_s": POSITIVE}),
    (schema.BenchTable, {}, {"silence_s": ([0.1, 60.0], [0.0999, 60.1, math.nan])}),
    (schema.RunTable, {}, {"step_s": ([1e-9, 1e9], [0.9e-9, math.inf, math.nan]), "layers_max": COUNT}),
    (schema.RunTable, {}, {"time_max_s real_time_factor": POSITIVE}),
    (schema.ConnectionTable, {"source": "a.b", "target": "c.d"}, {"gain": FINITE}),
    (schema.EventTable, EVENT, {"at_layer": COUNT, "at_time_s": NOT_NEGATIVE, "tilt_x tilt_y": FINITE}),
    (schema.EventTable, EVENT, {"cells": ([[[0, 1]], []], [[[0]], [[0, 1, 2]], [0, 1]])}),
    (MetrologyTable, {}, {"s_filter_um l_filter_um": POSITIVE, "filter_order": ([0, 1], [2, -1])}),
    (PortTable, {"variable": "x"}, {"gain offset": FINITE, "first": ([0, 5], [-1, 0.5])}),
    (ShadowTable, {}, {"alarm_um stop_um": POSITIVE}),
    (FaultTable, LOSS, {"probability": ([TINY, 1.0], [0.0, 1.0001]), "nth count frames": WORD, "id": whole(0, 0x7FF)}),
    (FaultTable, LOSS, {"service": whole(0, 0xBF), "byte": whole(0, 7), "layer": whole(0, 65535), "pass": whole(0, 3)}),
    (FaultTable, LOSS, {"seed": whole(0, 2**31 - 1)}),
    (Manifest, MANIFEST, {"width_pixels height_pixels drop_levels": COUNT, "pitch_x_um pitch_y_um": POSITIVE}),
    (Manifest, MANIFEST, {"files": ([[FILE]], [[]]), "format_version": ([1], [0, 2])}),
    (PrintTable, PITCH, {"pitch_um pixel_um count_scale inked_um": POSITIVE, "valid_share_min middle_share": SHARE}),
    (PrintTable, PITCH, {"invalid_value offset_x_um offset_y_um rotation_deg": FINITE}),
    (PrintTable, PITCH, {"passes": ([1, 4], [0, 2, 5]), "pass_rotation": whole(0, 3)}),
    (ManifestFile, FILE, {"layer": COUNT, "file": (["a b.png"], ["", "a/b.png", "a\\b.png", "a\0"])}),
    (ManifestInk, {"layer_height_um": 1.0}, {"layer_height_um": POSITIVE}),
]
"""Table, the least that it needs, and of its keys values that are taken and values that are not."""


@pytest.mark.parametrize(
    ("model", "needed", "key", "taken", "refused"),
    [
        (model, needed, key, *values)
        for model, needed, rows in LIMITS
        for keys, values in rows.items()
        for key in keys.split()
    ],
)
def test_key_takes_the_values_between_its_limits(
    model: type[BaseModel], needed: dict[str, Any], key: str, taken: list[Any], refused: list[Any]
) -> None:
    for value in taken:
        model.model_validate(needed | {key: value})
    for value in refused:
        with pytest.raises(ValidationError) as caught:
            model.model_validate(needed | {key: value})
        assert {detail["loc"][0] for detail in caught.value.errors() if detail["loc"]} == {key}, value


DEFAULTS: list[tuple[type[BaseModel], dict[str, Any], dict[str, Any]]] = [
    (Grid, GRID, {"pitch_um": 263.256}),
    (CylinderTable, CYLINDER, {"center_x_um": None, "center_y_um": None}),
    (
        SubstrateTable,
        {},
        {"tilt_x": 0.0, "tilt_y": 0.0, "step_um": 0.0, "wave_um": 0.0, "wavelength_um": 5000.0, "roughness_um": 0.0},
    ),
    (schema.Support, {}, {"kind": "around", "margin_cells": 2}),
    (schema.InkTable, {}, {"h1_um": 4.4, "h2_um": 0.6, "h3_um": 0.2}),
    (schema.Process, {}, {"passes": 1, "pass_order": "raster", "pass_rotation": 0}),
    (
        schema.BenchTable,
        {},
        {
            "bitrate": None, "data_bitrate": None, "bit_rate_switch": False, "traffic_log": "traffic.blf",
            "cure_ms": 100, "loop_timeout_s": 120.0, "grace_s": 0.5, "answer_s": 1.0, "silence_s": 0.3, "faults": [],
        },
    ),
    (
        schema.RunTable,
        {},
        {"step_s": 1.0, "algorithm": "gauss-seidel", "layers_max": 1000, "time_max_s": None, "real_time_factor": None},
    ),
    (schema.ConnectionTable, {"source": "a.b", "target": "c.d"}, {"gain": None, "mirror": "none", "transpose": False}),
    (schema.EventTable, EVENT, {"tilt_x": 0.0, "tilt_y": 0.0, "cells": None, "nozzles": None}),
]  # fmt: skip


@pytest.mark.parametrize(("model", "needed", "expected"), DEFAULTS, ids=[each[0].__name__ for each in DEFAULTS])
def test_key_that_is_left_out_has_its_default(
    model: type[BaseModel], needed: dict[str, Any], expected: dict[str, Any]
) -> None:
    found = model.model_validate(needed)
    assert {key: getattr(found, key) for key in expected} == expected


@pytest.mark.parametrize(
    ("interface", "channel", "found"),
    [
        ("inkloop_fmu", "bus.fmu", "jobs/bus.fmu"),
        ("inkloop_fmu", "/fmus/bus.fmu", "/fmus/bus.fmu"),
        ("inkloop_fmu", 0, 0),
        ("socketcan", "can0", "can0"),
    ],
)
def test_only_the_file_of_a_bus_lies_next_to_the_scenario(interface: str, channel: str | int, found: str | int) -> None:
    table = schema.BenchTable(interface=interface, channel=channel)
    assert table.found_from(Path("jobs")) == schema.BenchTable(interface=interface, channel=found)


def test_lengths_of_tables_become_metres() -> None:
    assert schema.InkTable(h1_um=4.0, h2_um=0.5, h3_um=0.25).ink == Ink(4e-6, 0.5e-6, 0.25e-6)


def test_the_table_becomes_an_evaluation_in_si() -> None:
    table = MetrologyTable.model_validate(
        {"parameters": ["Sq", "Rz"], "s_filter_um": 100.0, "l_filter_um": 800.0, "filter_order": 0, "profile": "y"}
    )
    treatment = Treatment("plane", 100.0 * M_PER_UM, 800.0 * M_PER_UM, 0)
    assert table.evaluation == Evaluation(("Sq", "Rz"), treatment, "y")
    assert MetrologyTable().evaluation == Evaluation(("Sa", "Sq", "Sz"))
    assert MetrologyTable(every_layer=True).evaluation.every_layer


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"parameters": ["Sa", "flatness_lz"]}, "'flatness_lz' is no parameter: did you mean flatness_ls"),
        ({"parameters": []}, "at least 1 item"),
        ({"parameters": ["Pa"]}, 'Pa need profile = "x" or "y" as well'),
        ({"parameters": ["Ra", "Rz"], "profile": "x"}, "Ra, Rz needs l_filter_um, the section length"),
        ({"parameters": ["Pa"], "profile": "x", "l_filter_um": 9.0}, "Pa is of profiles without l_filter_um"),
        ({"s_filter_um": 80.0, "l_filter_um": 80.0}, "expected s_filter_um below l_filter_um"),
        ({"s_filter_um": 90.0, "l_filter_um": 80.0}, "expected s_filter_um below l_filter_um"),
        ({"f_operation": "mean"}, "'none', 'plane', 'form' or 'target'"),
    ],
)
def test_what_cannot_be_evaluated_is_an_error(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        MetrologyTable.model_validate(keys)


@pytest.mark.parametrize(
    "text", ["loss:probability=0.001,way=to-nodes,seed=3", "reboot:nth=4,node=head,layer=2,pass=1,step=pass", "bus-off"]
)
def test_fault_is_written_as_it_is_read(text: str) -> None:
    assert str(read_fault(text)) == text
    assert str(read_fault("corruption:id=0x640")) == "corruption:id=1600"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lost", "kind is 'lost'; expected 'loss'"),
        ("loss:p=1", "p is not a key of this table"),
        ("loss:psas=1", r"did you mean pass\?"),
        ("loss:probability=2,way=up", r"probability is 2;.*way is 'up'; expected 'to-nodes' or 'from-nodes'"),
        ("loss:probability=0.5,nth=1", "expected probability, or nth, not both"),
        ("death", "needs node as well"),
        ("hang", "needs node as well"),
        ("slow-erase:frames=3", "needs node as well"),
        ("unreadable", "needs node as well"),
        ("unreadable:node=head,count=0", "count is 0"),
        ("short-queue:frames=0", "frames is 0"),
        ("transmit-order:node=hed", "expected .head., .stage."),
        ("broken:node=head", "needs part as well"),
    ],
)
def test_wrong_fault_is_refused_with_a_message(text: str, message: str) -> None:
    with pytest.raises(InkloopError, match=message):
        read_fault(text)


def test_scenario_lists_the_faults_and_all_its_errors_are_reported_at_once(tmp_path: Path) -> None:
    tables = '\n[[bench.faults]]\nkind = "death"\nnode = "cure"\nstep = "cure"\n[[bench.faults]]\nkind = "swap"\n'
    found = emulation_of(Scenario.load(write(tmp_path, BLOCK + tables))).faults
    assert [str(fault) for fault in found] == ["death:node=cure,step=cure", "swap"]
    wrong = tables.replace('"swap"', '"swop"').replace('"cure"', '"lamp"')
    with pytest.raises(ScenarioError) as raised:
        Scenario.load(write(tmp_path, BLOCK + wrong))
    for word in ("bench.faults.[0].node", "bench.faults.[0].step", "bench.faults.[1].kind is 'swop'"):
        assert word in str(raised.value)
