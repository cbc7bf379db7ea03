"""The ink file: every number with its unit, its interval and the option of the model that takes it."""

from __future__ import annotations

import math
import re
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from inkloop_lab.identify.candidates import conserving
from inkloop_lab.identify.identification import Comparison, Identification
from inkloop_lab.identify.ink_regression import InkEstimate
from inkloop_lab.identify.ink_writer import write_ink
from inkloop_lab.identify.one_step import Score
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.models import LayerDeposition, SuperpositionDeposition, VolumeAreaDeposition, YoungLaplaceDeposition

HEIGHTS = np.array([[4.4e-6, 0.6e-6, -0.1e-6], [3.0e-6, 0.5e-6, 0.3e-6]])
FAR = (4e-6, 0.6e-6, 0.2e-6, 0.15e-6, 0.1e-6, 0.05e-6)
LIQUID = YoungLaplaceDeposition(42.3e-6, 30e-15, math.radians(55.0), "linear", 4)
CAPS = SuperpositionDeposition(((60e-6, 8e-6),), 90e-6)
WORSE, BETTER = VolumeAreaDeposition(90e-6, 7e-6), VolumeAreaDeposition(90e-6, 6e-6, 6700.0, -20100.0, 1.0, -2.0, 50e-6)


def compared(name: str, model: Any, rms_um: float) -> Comparison:
    return Comparison(name, model, Score(rms_um * 1e-6, 0.1), ())


def written(folder: Path, *comparisons: Comparison, reach: int = 1) -> tuple[str, dict[str, Any]]:
    """The text of a file, and its tables."""
    record = PrintRecord("first", 90e-6, np.zeros((1, 4, 3), np.int32), np.zeros((2, 4, 3)))
    ink = InkEstimate(HEIGHTS, np.diag(np.arange(1.0, 7.0) ** 2 * 1e-16), 5, 0.3e-6, 0.125, 321)
    found = Identification((record, record), (record,), 0.25e-6, ink, None, None, comparisons, (), reach)
    write_ink(found, folder / "ink.toml", date(2026, 3, 9))
    text = (folder / "ink.toml").read_text(encoding="utf-8")
    return text, tomlkit.parse(text).unwrap()


def test_heights_stand_in_micrometres_with_their_intervals(tmp_path: Path) -> None:
    text, tables = written(tmp_path)
    assert tables["a"] == {"h1_um": 4.4, "h2_um": 0.6, "h3_um": 0.0}  # nothing below 0
    assert tables["b"] == {"h1_um": 3.0, "h2_um": 0.5, "h3_um": 0.3}
    widths = [float(width) for width in re.findall(r"\+- (\S+) \(95 %\)", text)]
    np.testing.assert_allclose(widths, 2.5706 * 0.01 * np.arange(1, 7), rtol=0.04)  # two digits
    assert "on 2026-03-09 from first, first." in text
    assert '[ink]  file = "ink.toml"' in text


def test_file_says_where_the_numbers_are_from(tmp_path: Path) -> None:
    _, tables = written(tmp_path, compared("one", CAPS, 0.5), Comparison("none", None, None, (), "no"))
    assert {**tables["identified"], "method": ""} == {
        "method": "", "prints": ["first", "first"], "pitch_um": pytest.approx(90.0, rel=1e-12, abs=0.0),
        "noise_um": 0.25, "droplet_std": 0.125, "growths": 321, "one_step_rms_um": {"one": 0.5},
    }  # fmt: skip


def test_models_have_their_options_in_the_units_of_their_keys(tmp_path: Path) -> None:
    plant = Comparison(conserving(2), LayerDeposition((FAR,)), None, ())
    models = (compared("worse", WORSE, 0.5), compared("better", BETTER, 0.2), compared("caps", CAPS, 0.3))
    _, tables = written(tmp_path, *models, compared("liquid", LIQUID, 0.4), plant, reach=2)
    found = tables["models"]
    heights = {f"h{k}_a_um": pytest.approx(height * 1e6, rel=1e-5, abs=0.0) for k, height in enumerate(FAR, start=1)}
    assert found["LayerDeposition"] == {"reach": 2, **heights}
    caps = {f"cap_{what}_{ink}_um": value for ink in "ab" for what, value in (("radius", 60.0), ("height", 8.0))}
    assert found["SuperpositionDeposition"] == caps
    assert found["YoungLaplaceDeposition"] == {"droplet_volume_pl": 30.0, "contact_angle_deg": 55.0}
    gains = {"mv_plus_per_um": 6.7e-3, "mv_minus_per_um": -0.0201, "ma_plus_per_um": 1e-6, "ma_minus_per_um": -2e-6}
    volume_area = found["VolumeAreaDeposition"]  # the better one of the two
    assert {name: volume_area[name] for name in gains} == gains
    assert (volume_area["height_scale_um"], volume_area["guard"], volume_area["limit_gains"]) == (6.0, True, True)
    assert volume_area["cap_radius_um"] == 50.0
