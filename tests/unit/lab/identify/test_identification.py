"""Which prints an ink is identified from, with which noise, and which models are compared; the fits are doubles."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_lab.identify import candidates as models
from inkloop_lab.identify import identification
from inkloop_lab.identify.candidates import candidates, conserving
from inkloop_lab.identify.identification import Comparison, Identification, identify
from inkloop_lab.identify.one_step import Score
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.scan_geometry import ScanGeometry
from inkloop_lab.identify.scan_registration import Registered
from inkloop_lab.models import LayerDeposition, SuperpositionDeposition, YoungLaplaceDeposition
from support.logged_print import made_up, random_layers

SHAPE = (40, 30)


def record_of(name: str, share: float, layers: int = 3, shape: tuple[int, int] = SHAPE, **process: Any) -> PrintRecord:
    """Droplets on this share of the first cells in each layer; a margin of 5 cells; scans of noise alone."""
    pattern = np.zeros((layers, *shape), np.int32)
    inner = pattern[:, 5:-5, 5:-5]
    inner[:] = np.arange(inner[0].size).reshape(inner[0].shape) % 20 < round(20 * share)
    inner[0] = 1  # all cells are touched
    measured = np.random.default_rng(len(name)).normal(0.0, 1e-6, (layers + 1, *shape))
    return PrintRecord(name, 1e-4, pattern, measured, **process)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Arguments of the fits, by name; `shifts` moves the scans of a print by so many cells along x."""
    seen: dict[str, Any] = {"shifts": {}}

    def register(record: PrintRecord, noise: float) -> Registered:
        terms = np.zeros(8)
        terms[0] = seen["shifts"].get(record.name, 0.0)
        placed = replace(record, name=f"{record.name} in register")
        return Registered(record, ScanGeometry(record.shape, 3, terms), placed, seen.get("note", ""))

    def refused(*given: Any) -> Any:
        seen["seed"] = given[2:] or None
        raise IdentificationError("too few drops")

    def regressed(records: Any, noise: float, *, geometries: Any) -> Any:
        seen["ink"] = [record.name for record in records], noise, [each.terms[0] for each in geometries]
        return SimpleNamespace()

    def compared(tried: Any, records: Any, noise: float, on_fit: Any) -> list[Comparison]:
        seen["compared"] = [each.name for each in tried], [(record.name, len(record.pattern)) for record in records]
        return [Comparison("no", None, None, (), "it has too few cells"), Comparison("yes", None, None, ())]

    for name, double in (("register", register), ("identify_volume_area", refused), ("identify_ink", regressed)):
        monkeypatch.setattr(identification, name, double)
    monkeypatch.setattr(identification, "compare", compared)
    return seen


def test_ink_is_of_the_prints_with_many_droplets_as_they_were_logged(asked: dict[str, Any]) -> None:
    """Of motifs a tenth of the touched cells is hit by a layer; the threshold is 15 %."""
    motifs, dense = record_of("motifs", 0.05, 10), record_of("dense", 0.1, 10)
    asked["shifts"] = {"motifs": 0.25, "dense": 0.75}
    found = identify([motifs, dense], noise_std=1e-6, seed=9)
    assert asked["ink"] == (["dense"], 1e-6, [0.75])
    assert asked["compared"][1] == [("dense in register", 10)]
    assert asked["seed"] == (9,)
    assert [record.name for record in found.records] == ["motifs in register", "dense in register"]
    assert [each.terms[0] for each in found.geometries] == [0.25, 0.75]
    identify([motifs], noise_std=1e-6)
    assert asked["ink"][0] == ["motifs"]  # there is nothing better
    assert asked["seed"] == (0,)


def test_reasons_of_all_parts_that_could_not_be_done_are_noted(asked: dict[str, Any]) -> None:
    asked["note"] = "the scans look displaced"
    notes = identify([record_of("dense", 0.5)], noise_std=1e-6).notes
    assert notes[0] == "the scans look displaced"
    assert notes[1].startswith("droplet protocol: first layers hold ")
    assert notes[2:] == ("Wu and Chiu's coefficients: too few drops", "no: it has too few cells")


def test_models_are_compared_over_some_twelve_thousand_growths(asked: dict[str, Any]) -> None:
    one, other = record_of("a", 0.5, 7), record_of("b", 0.5, 4)
    found = identify([one, other], noise_std=1e-6)
    assert asked["compared"][1] == [("a in register", 5), ("b in register", 4)]  # 12000 / (2 x 1200)
    assert "models are compared over the first 5 layers of each print" in found.notes
    wide = record_of("wide", 0.5, 3, (120, 110))
    identify([wide], noise_std=1e-6)
    assert asked["compared"][1] == [("wide in register", 2)]  # two at least
    short = identify([record_of("a", 0.5, 5), other], noise_std=1e-6)
    assert not any("models are compared over" in note for note in short.notes)


def test_noise_is_of_cells_that_no_displaced_reading_of_a_droplet_reaches(asked: dict[str, Any]) -> None:
    """Scans two cells off read the droplets four cells from their own; noise that is given stays."""
    record = record_of("dense", 0.5)
    record.measured[:] *= 0.01
    beside = record.untouched(2) & ~record.untouched(4)
    record.measured[1:, beside] += np.random.default_rng(1).normal(0.0, 50e-6, (3, int(beside.sum())))
    assert identify([record]).noise_std > 10e-6
    asked["shifts"] = {"dense": 2.0}
    assert identify([record]).noise_std == pytest.approx(0.01e-6, rel=0.1, abs=0.0)
    assert asked["ink"][1] == pytest.approx(0.01e-6, rel=0.1, abs=0.0)
    assert identify([record], noise_std=3e-6).noise_std == 3e-6


def test_all_prints_that_do_not_belong_to_the_first_are_named_with_what_differs() -> None:
    first = record_of("first", 0.5)
    others = [
        replace(record_of("pitch", 0.5), pitch=90e-6),
        record_of("passes", 0.5, passes=4),
        record_of("order", 0.5, pass_order=2),
        record_of("rotation", 0.5, pass_rotation=3),
    ]
    with pytest.raises(IdentificationError) as caught:
        identify([first, *others], noise_std=1e-6)
    assert [line.partition(";")[0] for line in str(caught.value).splitlines()] == [
        "pitch: pitch_um 90, first: 100",
        "passes: passes 4, first: 1",
        "order: pass_order 2, first: 1",
        "rotation: pass_rotation 3, first: 0",
    ]
    with pytest.raises(IdentificationError, match="no print was given"):
        identify([])


def test_plant_is_the_one_of_the_reach_asked_for() -> None:
    near, far = LayerDeposition(), LayerDeposition(((4e-6, *5 * (1e-7,)),))
    comparisons = (
        Comparison("Lu, regression", near, Score(1e-6, 0.5), ()),
        Comparison(conserving(2), far, Score(3e-6, 0.1), ()),
        Comparison("refused", None, None, ()),
    )
    found = Identification((), (), 0.0, SimpleNamespace(), None, None, comparisons, ())  # type: ignore[arg-type]
    assert found.plant is None
    assert replace(found, reach=2).plant is far
    assert replace(found, reach=3).plant is None


def test_candidates_are_fitted_in_the_way_that_their_names_say(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[Any]()

    def fitted(records: Any, noise: float, **options: Any) -> Any:
        asked.append((noise, options["reach"], options["correct"], options["conserve"]))
        return SimpleNamespace(heights=np.full((1, {1: 3, 2: 6, 3: 10}[options["reach"]]), 1e-6))

    monkeypatch.setattr(models, "identify_ink", fitted)
    record, cells = record_of("it", 0.5, passes=4, pass_order=2, pass_rotation=3), [np.ones(SHAPE, np.bool_)]
    volume_area: Any = SimpleNamespace(model=lambda pitch: pitch)
    found = {one.name: one.fit for one in candidates([Ink()], 0.2e-6, (4e-6, 1e-6, -1e-7), volume_area, reach=3)}
    assert list(found) == [
        "Lu, nominal ink", "Lu, droplet protocol", "Wu, Chiu by (17)", "Lu, plain regression", "Lu, regression",
        "Lu, regression, reach 2", "Lu, reach 3, volume kept", "spherical caps", "Wu, Chiu, fitted", "Young-Laplace",
    ]  # fmt: skip
    for name in list(found)[3:7]:
        found[name]([record], cells)
    assert asked == [
        (0.2e-6, 1, False, False), (0.2e-6, 1, True, False), (0.2e-6, 2, True, False), (0.2e-6, 3, True, True),
    ]  # fmt: skip
    protocol = found["Lu, droplet protocol"]([record], cells)
    assert protocol == LayerDeposition(((4e-6, 1e-6, 0.0),), 4, 2, 3)  # no height is below 0
    assert found["Wu, Chiu by (17)"]([record], cells) == 1e-4
    two = replace(record, pattern=record.pattern * 2)
    ink = (4.4e-6, 0.6e-6, 0.2e-6)
    assert found["Lu, nominal ink"]([record, two], cells) == LayerDeposition((ink, ink), 4, 2, 3)
    for name in ("spherical caps", "Wu, Chiu, fitted"):
        with pytest.raises(IdentificationError, match="fitted to prints in one material only"):
            found[name]([record, two], cells)
    names = [one.name for one in candidates([Ink()], 0.2e-6)]
    assert names == [name for name in found if name not in list(found)[1:3] and "volume kept" not in name]


def test_caps_and_liquid_of_exact_scans_are_those_of_the_plant() -> None:
    """Each from some of the cells; others hold nonsense."""
    caps, pitch = SuperpositionDeposition(((130e-6, 6e-6),), 100e-6), 100e-6
    record = replace(made_up(caps, random_layers(14, 13, 2, 1, margin=3)), pitch=pitch)
    mask = np.ones((14, 13), np.bool_)
    mask[:, 6] = False
    (fit,) = (one.fit for one in candidates([Ink()], 0.0) if one.name == "spherical caps")
    found = fit([record], [mask])
    assert isinstance(found, SuperpositionDeposition)
    assert found.caps[0] == pytest.approx(caps.caps[0], rel=0.02, abs=0.0)
    spoilt = record.measured.copy()
    spoilt[-1, :, 6] += 30e-6
    again = fit([replace(record, measured=spoilt)], [mask])
    assert isinstance(again, SuperpositionDeposition)
    assert again.caps[0] == pytest.approx(caps.caps[0], rel=0.02, abs=0.0)


def test_flattest_droplet_is_the_first_one_that_the_model_takes() -> None:
    tried = list[float]()

    def model(angle: float) -> YoungLaplaceDeposition:
        tried.append(angle)
        if angle < np.radians(33.0):
            raise ValueError("spreads too far")
        return YoungLaplaceDeposition()

    assert models._least_angle(model) == pytest.approx(np.radians(35.0), rel=1e-9, abs=0.0)
    np.testing.assert_allclose(np.degrees(tried), [15.0, 20.0, 25.0, 30.0, 35.0], rtol=1e-9)
