"""A print job or a port made in Python: what cannot be is refused where it is made."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job, Port
from inkloop.component_errors import HEIGHT_MOST, INK_MOST, PITCH_LEAST
from inkloop_controller.problem.options import variables

SHAPE = 5, 4
PART = np.ones(SHAPE, np.bool_)
TOP = np.full(SHAPE, 3e-5)
JOB = Job(5, 4, 1e-4, TOP, PART)
MICROMETRES = "heights in metres, within 0.4 m"


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("nx", 0, "nx is 0; needs a number of cells"),
        ("ny", 4.5, "ny is 4.5; needs a number of cells"),
        ("pitch", 0.0, "pitch is 0.0; needs a length of a cell in metres"),
        ("pitch", np.inf, "pitch is inf; needs a length of a cell in metres"),
        ("pitch", "1e-4", "pitch is '1e-4'; needs a length of a cell in metres"),
        ("seed", 1.5, "seed is 1.5; needs a whole number"),
        ("target_height", TOP.T, "target_height has shape (4, 5); needs (5, 4)"),
        ("target_height", TOP.tolist(), "target_height is a list; needs an array of float64"),
        ("target_height", TOP.astype(np.float32), "target_height has dtype float32; needs float64"),
        ("target_height", 1e6 * TOP, f"target_height is 30 at cell (0, 0); needs {MICROMETRES}"),
        ("target_height", -1e6 * TOP, f"target_height is -30 at cell (0, 0); needs {MICROMETRES}"),
        ("target_height", np.where(np.eye(5, 4, 2), np.nan, TOP), "target_height is nan at cell (0, 2); needs"),
        ("mask", PART.T, "mask has shape (4, 5); needs (5, 4)"),
        ("mask", PART.astype(np.int64), "mask has dtype int64; needs bool"),
        ("height_start", TOP.T, "height_start has shape (4, 5); needs (5, 4)"),
        ("height_start", TOP * np.nan, f"height_start is nan at cell (0, 0); needs {MICROMETRES}"),
        ("region", "x", "region is 'x'; needs a Geometry, with its method intervals"),
        ("inks", (), "inks is (); needs one Ink or two"),
        ("inks", Ink(), "inks is Ink("),
        ("inks", (4.4e-6,), "inks[0].h1 is None; needs a height in metres"),
        ("inks", (Ink(), Ink(), Ink()), "inks is ("),
        ("inks", (Ink(4.4, 0.0, 0.0),), "inks[0].h1 is 4.4; needs a height in metres, above 0 to 0.001 m"),
        ("inks", (Ink(), Ink(h1=0.0)), "inks[1].h1 is 0.0; needs a height in metres, above 0 to 0.001 m"),
        ("inks", (Ink(h2=-1e-7),), "inks[0].h2 is -1e-07; needs a height in metres, from 0 to 0.001 m"),
        ("inks", (Ink(h3=float("nan")),), "inks[0].h3 is nan; needs a height in metres, from 0 to 0.001 m"),
    ],
)
def test_job_that_no_print_has_is_refused_by_its_field(field: str, value: Any, error: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(error)}"):
        replace(JOB, **{field: value})


def test_all_errors_of_a_job_are_in_one_sentence() -> None:
    with pytest.raises(
        ValueError, match=r"^pitch is -1; .*; target_height is 30 at .*; mask has shape .*; inks is \(\)"
    ):
        Job(5, 4, -1, 1e6 * TOP, PART.T, ())


@pytest.mark.parametrize(
    ("field", "value"),
    [("nx", np.int64(5)), ("pitch", np.float32(1e-4)), ("inks", [Ink(h2=0.0, h3=0.0), Ink()]), ("height_start", -TOP)],
)
def test_job_of_other_number_types_and_of_two_inks_is_taken(field: str, value: Any) -> None:
    assert getattr(replace(JOB, **{field: value}), field) is value


def test_limits_are_those_of_the_controller_fmu() -> None:
    of_fmu = variables()
    assert of_fmu["target_height"].max == HEIGHT_MOST
    assert of_fmu["pitch"].min == PITCH_LEAST
    assert {of_fmu[f"{h}_{ink}"].max for h in ("h1", "h2", "h3") for ink in "ab"} == {INK_MOST}


@pytest.mark.parametrize(
    ("fields", "error"),
    [
        ({"name": ""}, "ports: '': has no name"),
        ({"shape": (2, -1)}, "ports: 'y': shape is (2, -1); needs a tuple of lengths"),
        ({"shape": 3}, "ports: 'y': shape is 3; needs a tuple"),
        ({"shape": (2.0,)}, "ports: 'y': shape is (2.0,); needs a tuple"),
        ({"dtype": "flot64"}, "ports: 'y': dtype is 'flot64'; needs the name of a type of numbers"),
        ({"dtype": "object"}, "ports: 'y': dtype is 'object'; needs the name of a type of numbers"),
        ({"dtype": "U8"}, "ports: 'y': dtype is 'U8'; needs the name of a type of numbers"),
        ({"shape": (3,), "start": np.zeros(4)}, "ports: 'y': start has shape (4,); needs (3,), or one number"),
        ({"dtype": "int32", "start": 1.5}, "ports: 'y': start is 1.5; needs a value of int32"),
        ({"dtype": "bool", "start": 2.0}, "ports: 'y': start is 2.0; needs a value of bool"),
        ({"dtype": None}, "ports: 'y': dtype is None; needs the name of a type of numbers"),
        ({"dtype": "f8,,"}, "ports: 'y': dtype is 'f8,,'; needs the name of a type of numbers"),
        ({"dtype": "uint8", "start": 300}, "ports: 'y': start is 300; needs a value of uint8"),
        ({"dtype": "int32", "start": 3e9}, "ports: 'y': start is 3000000000.0; needs a value of int32"),
        ({"dtype": "int32", "start": np.nan}, "ports: 'y': start is nan; needs a value of int32"),
        (
            {"dtype": "int32", "shape": (2,), "start": np.array([1.0, 2.5])},
            "ports: 'y': start is 2.5; needs a value of",
        ),
        ({"start": None}, "ports: 'y': start is None; needs a number, or an array of numbers"),
        ({"start": "x"}, "ports: 'y': start is 'x'; needs a number, or an array of numbers"),
        ({"shape": (2,), "start": [[1.0], [1.0, 2.0]]}, "ports: 'y': start is [[1.0], [1.0, 2.0]]; needs a number"),
        (
            {"shape": (-1,), "dtype": "x"},
            "ports: 'y': shape is (-1,); needs a tuple of lengths, () for a scalar; dtype",
        ),
    ],
)
def test_port_that_cannot_be_is_refused_by_its_field(fields: dict[str, Any], error: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(error)}"):
        Port(**{"name": "y", **fields})


@pytest.mark.parametrize(
    "fields",
    [
        {"start": np.nan},
        {"dtype": "bool", "start": 1.0},
        {"shape": (0, 2)},
        {"shape": (2,), "start": np.ones(2)},
        {"dtype": "float32", "start": np.float64(0.1)},
        {"start": -np.inf},
        {"dtype": "int64", "start": 2**62},
    ],
)
def test_port_of_any_numbers_is_taken(fields: dict[str, Any]) -> None:
    port = Port("y", **fields)
    assert port.start_value().shape == port.shape
