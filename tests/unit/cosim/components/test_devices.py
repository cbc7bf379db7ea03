"""The job of a device has the passes of its options, as the model in its place takes them."""

from __future__ import annotations

from typing import Any

import pytest

from inkloop.components.devices import job_with_overrides
from inkloop.testing import job as small_job


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, (1, 1, 0)),
        ({"passes": 4, "pass_order": "diagonal", "pass_rotation": 3}, (4, 2, 3)),
        ({"passes": 4, "pass_order": 1}, (4, 1, 0)),
    ],
)
def test_passes_of_the_options_win_over_those_of_the_job(
    options: dict[str, Any], expected: tuple[int, int, int]
) -> None:
    job = small_job(6, 5)
    found = job_with_overrides(job, options)
    assert (found.passes, found.pass_order, found.pass_rotation) == expected
    assert (found.nx, found.ny, found.pitch, found.inks) == (job.nx, job.ny, job.pitch, job.inks)
