"""The ink of displaced scans is that of the print; scans in register stay as they are, on plants of any kind.

Prints and scans are those of the rig: its plant and its profiler are written independently of the product.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop_lab.identify import designs, scan_registration
from inkloop_lab.identify.identification import identify
from inkloop_lab.identify.ink_regression import InkEstimate, identify_ink
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.print_record import record_of as record_of_run
from inkloop_lab.identify.scan_geometry import TERMS, ScanGeometry
from inkloop_lab.identify.scan_registration import register
from inkloop_lab.identify.surface_filter import innovations
from support.logged_print import random_layers
from support.lying_scans.log import EVEN, logged
from support.lying_scans.plant import CAP, WIDE, Plant
from support.lying_scans.profiler import Profiler
from support.places import SCENARIOS

TRUE = np.array([4.4, 0.6, 0.2])
MUST = [0.03, 0.06, 0.09]
NOISE = 1.0  # um
LAYERS = 12
DISPLACED: Mapping[str, Mapping[str, Any]] = {
    "shift along x": {"shift": (0.25, 0.0)},
    "shift against x": {"shift": (-0.25, 0.0)},
    "shift along y": {"shift": (0.0, 0.25)},
    "shift against y": {"shift": (0.0, -0.25)},
    "rotation": {"rotation": 1.0},
    "rotation back": {"rotation": -1.0},
    "magnification": {"magnification": 0.02},
    "magnification below 1": {"magnification": -0.02},
    "drifting shift": {"shift": (-0.2, 0.15), "drift": (0.5, -0.3)},
    "together": {"shift": (0.25, -0.25), "rotation": 1.0, "magnification": 0.02, "shear": 0.005},
    "scattered": {"shift": (0.3, 0.2), "shift_std": 0.1},
}
IN_REGISTER: Mapping[str, Plant] = {
    "as the model": EVEN,
    "varied": Plant(variation=0.4),
    "no flow": Plant(flows=False),
    "caps": Plant(CAP, flows=False),
    "wide": Plant(WIDE),
    "bleeding": Plant(bleeding=0.15),
    "right half": Plant(volume_right=0.15),
    "shrinks": Plant(kept=0.97),
}


def record_of(
    shape: tuple[int, int], seed: int, count: int = LAYERS, plant: Plant = EVEN, **faults: Any
) -> PrintRecord:
    return logged(Profiler(**faults), designs.layers(*shape, count, seed, margin=4), seed, plant)


def errors_of(found: InkEstimate) -> Any:
    return found.heights[0] * 1e6 / TRUE - 1.0


ROWS = [
    pytest.param(faults, shape, seed, id=f"{name}, {shape[0]} x {shape[1]}", marks=[pytest.mark.long] * is_again)
    for row, (name, faults) in enumerate(DISPLACED.items())
    for is_again, (shape, seed) in enumerate((((40, 34), 4), ((34, 40), 5))[:: 1 - 2 * (row % 2)])
]
"""Each fault on one shape, and again on the other one."""


@pytest.mark.parametrize(("faults", "shape", "seed"), ROWS)
def test_ink_of_displaced_scans_is_that_of_the_print(
    faults: Mapping[str, Any], shape: tuple[int, int], seed: int
) -> None:
    record = record_of(shape, seed, noise=NOISE, **faults)
    placed = register(record, NOISE * 1e-6)
    found = identify_ink([record], NOISE * 1e-6, geometries=[placed.geometry])
    assert (np.abs(errors_of(found)) < MUST).all(), errors_of(found)
    assert (np.abs(errors_of(identify_ink([record], NOISE * 1e-6))) > MUST).any()  # without it they are too large
    terms, x, y = placed.geometry.terms, *(0.5 * (np.array(shape) - 1.0))
    drift = 0.5 * np.array(faults.get("drift", (0.0, 0.0)))
    middle = np.array(faults.get("shift", (0.0, 0.0))) + drift
    turn, size = np.deg2rad(faults.get("rotation", 0.0)), 1.0 + faults.get("magnification", 0.0)
    shear = np.array([[1.0, faults.get("shear", 0.0)], [0.0, 1.0]])
    whole = size * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ shear - np.eye(2)
    slack = 0.12 if "shift_std" in faults else 0.05
    np.testing.assert_allclose(terms[:2], middle, atol=slack)
    np.testing.assert_allclose(terms[2:6].reshape(2, 2), whole * [x, y], atol=slack)
    np.testing.assert_allclose(terms[6:], drift, atol=slack)


@pytest.mark.system
def test_closed_loop_under_a_misaligned_profiler_identifies_its_ink() -> None:
    """Scans shifted by a third and a quarter of a cell, a tenth more or less from scan to scan; droplets lack 10 %."""
    record = record_of_run(print_part(Scenario.load(SCENARIOS / "misaligned-scan.toml")), "misaligned-scan")
    placed = register(record, 0.0)
    np.testing.assert_allclose(placed.geometry.terms[:2], [0.333, -0.25], atol=0.05)
    found = identify_ink([record], 0.0, geometries=[placed.geometry]).heights[0] * 1e6
    assert (np.abs(found / (0.9 * TRUE) - 1.0) < MUST).all()
    assert placed.geometry.describe().startswith("lie +0.3")


def test_exact_displaced_scans_give_the_ink_exactly() -> None:
    record = record_of((26, 22), 3, 4, shift=(0.25, 0.1), rotation=0.5)
    placed = register(record, 0.0)
    found = identify_ink([record], 0.0, geometries=[placed.geometry])
    np.testing.assert_allclose(found.heights[0] * 1e6, TRUE, rtol=1e-3)


@pytest.mark.parametrize("shift", [(-1.25, 0.7), (2.0, 2.0)])
def test_shift_beyond_a_cell_is_found(shift: tuple[float, float]) -> None:
    """The second one from where the growth shows it: from none the fit ends elsewhere."""
    record = record_of((32, 28), 1, 5, shift=shift, noise=1.0)
    np.testing.assert_allclose(register(record, 1e-6).geometry.terms[:2], shift, atol=0.05)


@pytest.mark.parametrize(
    ("plant", "noise"),
    [*((plant, 0.0) for plant in IN_REGISTER), *((plant, 0.7) for plant in ("as the model", "no flow", "wide"))],
)
def test_scans_in_register_stay_as_they_are(plant: str, noise: float) -> None:
    record = record_of((26, 22), 6, 5, IN_REGISTER[plant], noise=noise)
    placed = register(record, noise * 1e-6)
    assert placed.geometry.is_none
    assert placed.record is record
    assert placed.note == ""


def test_wide_spot_does_not_pass_for_a_magnification() -> None:
    placed = register(record_of((30, 26), 3, 6, spot=1.0, noise=0.3), 0.3e-6)
    assert placed.geometry.is_none
    assert "the scans of log look as if they lie" in placed.note
    assert "wide spot: not corrected; check the profiler" in placed.note


def test_registered_surfaces_are_those_of_the_print() -> None:
    """Nearer than the scans by far, where the scan was valid; droplets vary, so that the model does not know it all."""
    varied = Plant(variation=0.4)
    exact = record_of((30, 26), 3, 6, varied)
    record = record_of((30, 26), 3, 6, varied, shift=(0.25, -0.25), rotation=1.0, noise=0.2)
    record.measured[3, 5, 7] = np.nan
    placed = register(record, 0.2e-6)
    assert np.array_equal(np.isnan(placed.record.measured), np.isnan(record.measured))

    def distance(one: PrintRecord) -> float:
        return float(np.sqrt(np.nanmean((one.measured - exact.measured) ** 2)))

    assert distance(record) > 1.1e-6
    assert distance(placed.record) < 0.25e-6


def test_sensitivity_of_the_innovations_is_their_change_with_the_geometry() -> None:
    """In the mean over the readings: slopes are means of both sides of a cell. The surface that the filter carries
    moves with the geometry, so that a late layer shows little more of it than an early one.
    """
    record = record_of((30, 26), 3, 6, shift=(0.3, -0.3), noise=0.1)
    heights, here = TRUE[None] * 1e-6, ScanGeometry((30, 26), 6, np.array([0.3, -0.3, 0, 0, 0, 0, 0, 0]))
    steps = list(innovations(record, heights, 0.1e-6, 0.01, here, tangent=True))
    for term in range(TERMS):
        moved = innovations(record, heights, 0.1e-6, 0.01, here.moved(1e-3 * np.eye(TERMS)[term]))
        for step, other in list(zip(steps, moved, strict=True))[-2:]:
            change, expected = (step.error - other.error) / 1e-3, step.sensitivity[term]
            assert change @ expected / (expected @ expected) == pytest.approx(1.0, abs=0.1)


LAYER = 8e-6
"""Height that a droplet adds over a cell [m]; residuals of a fortieth of it are little."""


def estimate(unexplained: float, terms: Mapping[int, float], std: float = 0.01) -> InkEstimate:
    """Of scans of 31 x 21 cells with these terms of their geometry [cells], each known to `std`."""
    own = np.zeros(TERMS)
    own[list(terms)] = list(terms.values())
    geometry = ScanGeometry((31, 21), 4, own)
    heights, covariance = np.array([[4e-6, 0.6e-6, 0.2e-6]]), np.eye(3)
    return InkEstimate(heights, covariance, 5, 0.0, 0.1, 9, 0.004, unexplained, geometry, np.eye(TERMS) * std**2)


@pytest.mark.parametrize(
    ("terms", "std", "share", "plain", "is_accepted"),
    [
        ({0: 0.1}, 0.01, 0.44, 1e-12, True),
        ({0: 0.1}, 0.01, 0.46, 1e-12, False),  # explains too little of it
        ({0: 0.041}, 0.001, 0.1, 1e-12, True),
        ({1: 0.039}, 0.001, 0.1, 1e-12, False),  # changes nothing
        ({0: 0.0633}, 0.01, 0.1, 1e-12, True),
        ({0: 0.0632}, 0.01, 0.1, 1e-12, False),  # 39.9 of a chi-square
        ({2: 0.89}, 0.01, 0.1, 1e-12, True),
        ({2: 0.91}, 0.01, 0.1, 1e-12, False),  # 0.0607 per cell over 15 cells
        ({5: -0.61}, 0.01, 0.1, 1e-12, False),  # -0.061 over 10
        ({0: 0.1}, 0.01, 0.1, 1.01 * 0.04e-12, True),
        ({0: 0.1}, 0.01, 0.1, 0.99 * 0.04e-12, False),  # there is little to explain
    ],
)
def test_geometry_is_accepted_that_is_certain_no_spot_and_explains_half(
    terms: Mapping[int, float], std: float, share: float, plain: float, is_accepted: bool
) -> None:
    found = scan_registration._explains(estimate(share * plain, terms, std), estimate(plain, {}), LAYER)
    assert found == is_accepted
    assert not scan_registration._explains(
        replace(estimate(0.0, terms, std), geometry=None), estimate(plain, {}), LAYER
    )


@pytest.mark.parametrize(
    ("terms", "std", "is_noted"),
    [({0: 0.25}, 0.0075, True), ({0: 0.25}, 0.0083, False), ({0: 0.19}, 0.001, False)],
    ids=["certain and far", "less than 1000 of a chi-square", "within a fifth of a cell"],
)
def test_rejected_geometry_is_noted_where_it_is_certain_and_far(
    terms: Mapping[int, float], std: float, is_noted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = iter([estimate(1e-12, {}), estimate(0.9e-12, terms, std)])
    monkeypatch.setattr(scan_registration, "identify_ink", lambda *_, **__: next(fits))
    placed = register(record_of((26, 22), 3, 3), 0.0)
    assert placed.geometry.is_none
    assert ("look as if they lie +0.25 cells along x" in placed.note) == is_noted
    assert bool(placed.note) == is_noted


def test_geometry_of_patterns_that_separate_nothing_is_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any, **__: Any) -> Any:
        raise IdentificationError("the patterns do not separate h2")

    monkeypatch.setattr(scan_registration, "identify_ink", refused)
    placed = register(record_of((26, 22), 3, 3), 0.0)
    assert placed.geometry.is_none
    assert placed.note == "geometry of the scans of log: the patterns do not separate h2"


def test_every_log_that_does_not_show_its_patterns_is_named_at_once() -> None:
    wrong = [
        logged(Profiler(noise=0.5, turned=turn), random_layers(20, 18, 3, 1, margin=3), name=f"log of {turn}")
        for turn in ("mirrored in x", "mirrored in y")
    ]
    right = logged(Profiler(noise=0.5), random_layers(20, 18, 3, 1, margin=3), name="right")
    with pytest.raises(IdentificationError) as caught:
        identify([wrong[0], right, wrong[1]], noise_std=0.5e-6)
    lines = str(caught.value).splitlines()
    assert [line.partition(": so")[0] for line in lines] == [
        "log of mirrored in x: the scans are mirrored in x",
        "log of mirrored in y: the scans are mirrored in y",
    ]


def test_all_of_identification_is_of_scans_in_register(monkeypatch: pytest.MonkeyPatch) -> None:
    """The droplet protocol, which reads single cells, finds the ink of displaced scans too; the sentence says how."""
    monkeypatch.setattr("inkloop_lab.identify.identification.compare", lambda *_: [])
    side = designs.droplets_side(20)
    record = logged(Profiler(noise=0.2, shift=(0.25, 0.1)), designs.droplets(side, side), name="motifs")
    layers = replace(record_of((30, 26), 3, 5, shift=(0.25, 0.1), noise=0.2), name="layers")
    found = identify([record, layers])
    assert found.protocol is not None
    np.testing.assert_allclose(np.array(found.protocol.heights) * 1e6, TRUE, atol=0.1)
    assert (np.abs(errors_of(found.ink)) < MUST).all()
    assert found.noise_std == pytest.approx(0.2e-6, rel=0.1, abs=0.0)
    assert [sentence.partition(", drift")[0] for sentence in found.displaced] == [
        "the scans of motifs lie +0.25 cells along x and +0.10 along y",
        "the scans of layers lie +0.25 cells along x and +0.10 along y",
    ]
