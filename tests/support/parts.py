"""Scenarios around a `[part]` table, to be read only."""

from __future__ import annotations

from pathlib import Path

from inkloop.scenario.file import Scenario

NX, NY, PITCH_UM = 14, 12, 100.0
TWO_INKS = """shape = "combine"
op = "union"
inks = ["A", "B"]
parts = [
    { shape = "cuboid", size_x_um = 400.0, size_y_um = 400.0, height_um = 30.0, center_x_um = 450.0 },
    { shape = "cuboid", size_x_um = 400.0, size_y_um = 600.0, height_um = 20.0, center_x_um = 850.0 },
]"""
"""Two cuboids side by side, one of each ink."""


def with_part(part: str, folder: Path, *, nx: int = NX, ny: int = NY, pitch_um: float = PITCH_UM) -> Scenario:
    """A scenario in `folder` with a part; part: the keys of the table, and tables after it. Raises ScenarioError."""
    text = f"""
title = "A part"
grid = {{ nx = {nx}, ny = {ny}, pitch_um = {pitch_um} }}
[components.controller]
kind = "OpenLoop"
[components.printer]
kind = "LayerDeposition"
[components.profiler]
kind = "ProfileSensor"
preset = "exact"
[part]
{part}
"""
    return Scenario.of_text(text, str(folder / "part.toml"))
