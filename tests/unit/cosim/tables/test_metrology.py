"""`[metrology]`: what may be asked for, and the message for what may not."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from inkloop.metrology.evaluation.definitions import Evaluation, Treatment
from inkloop.tables.metrology import MetrologyTable
from inkloop.units import M_PER_UM


def test_the_table_becomes_an_evaluation_in_si() -> None:
    table = MetrologyTable.model_validate(
        {"parameters": ["Sq", "Rz"], "s_filter_um": 100.0, "l_filter_um": 800.0, "filter_order": 0, "profile": "y"}
    )
    treatment = Treatment("plane", 100.0 * M_PER_UM, 800.0 * M_PER_UM, 0)
    assert table.evaluation == Evaluation(("Sq", "Rz"), treatment, "y")
    assert MetrologyTable().evaluation == Evaluation(("Sa", "Sq", "Sz"))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"parameters": ["Sa", "flatness_lz"]}, "'flatness_lz' is no parameter: did you mean flatness_ls"),
        ({"parameters": []}, "at least 1 item"),
        ({"parameters": ["Pa"]}, 'Pa need profile = "x" or "y" as well'),
        ({"parameters": ["Ra", "Rz"], "profile": "x"}, "Ra, Rz needs l_filter_um, the section length"),
        ({"parameters": ["Pa"], "profile": "x", "l_filter_um": 9.0}, "Pa is of profiles without l_filter_um"),
        ({"s_filter_um": 90.0, "l_filter_um": 80.0}, "expected s_filter_um below l_filter_um"),
        ({"f_operation": "mean"}, "'none', 'plane', 'form' or 'target'"),
    ],
)
def test_what_cannot_be_evaluated_is_an_error(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        MetrologyTable.model_validate(keys)
