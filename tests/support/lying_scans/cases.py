"""All cases of the rig by name."""

from __future__ import annotations

from support.lying_scans import lying_cases, plant_cases, scan_cases

CASES = {case.name: case for case in (*scan_cases.CASES, *plant_cases.CASES, *lying_cases.CASES)}
