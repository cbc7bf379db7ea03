"""The examples of properties: the same in every run of `make test`, others in each run of `make test-long`."""

from __future__ import annotations

import os
import subprocess
import sys

from support.places import ROOT

PROGRAM = "import conftest; print(*(conftest.settings.get_profile(name).derandomize for name in ('same', 'random')))"


def test_examples_are_the_same_until_random_ones_are_asked_for_in_continuous_integration_too() -> None:
    """Where the environment has CI, Hypothesis makes the examples of every profile the same that does not refuse."""
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "CI": "true", "PYTHONPATH": str(ROOT / "tests")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.split() == ["True", "False"]
