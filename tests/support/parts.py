"""Scenarios around a `[part]` table, to be read only."""

from __future__ import annotations

from pathlib import Path

from inkloop.scenario.file import Scenario

NX, NY, PITCH_UM = 14, 12, 100.0


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
