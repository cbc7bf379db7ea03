"""Support of a part: the substrate, and below overhangs that of the file, which has to name it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from inkloop.component import Job
from inkloop.errors import ScenarioError
from inkloop.geometry import Columns, PipeJunction, cell_centers, contained
from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop.tables.job import _without_ends, inks_of
from inkloop.tables.schema import Inks, InkTable
from inkloop.tables.shapes import Bounds, Grid, PipeJunctionTable, Solid, SubstrateTable
from support.places import SCENARIOS

PITCH = 100e-6
MIDDLE = 10 * PITCH
PIPES = PipeJunction(MIDDLE, MIDDLE, 7e-4, 30e-6, 4e-4, 16e-6, 60e-6)
TEXT = """
title = "pipes"
[grid]
nx = 21
ny = 21
pitch_um = 100.0
[part]
shape = "pipe-junction"
outer_across_um = 700.0
outer_upright_um = 30.0
inner_across_um = 400.0
inner_upright_um = 16.0
height_um = 60.0
[components.controller]
kind = "OpenLoop"
[components.printer]
kind = "LayerDeposition"
[components.profiler]
kind = "ProfileSensor"
scan_duration_s = 0.0
[run]
layers_max = 3
"""


def loaded(tmp_path: Path, support: str | None) -> Scenario:
    path = tmp_path / "pipes.toml"
    path.write_text(TEXT + ("" if support is None else f'[support]\nkind = "{support}"\n'))
    return Scenario.load(path)


def ends() -> tuple[Any, Any]:
    """Bottom of the lowest wall and top of the highest one on each cell [m], NaN where there is none."""
    x, y = cell_centers(21, 21, PITCH)
    across = np.minimum(np.abs(x - MIDDLE), np.abs(y - MIDDLE)) / 7e-4
    with np.errstate(invalid="ignore"):
        half = 30e-6 * np.sqrt(1.0 + 1e-9 - across**2)
    return 30e-6 - half, 30e-6 + half


def test_pipes_have_no_end_along_either_axis() -> None:
    part = tomlkit.parse(TEXT)["part"].unwrap()
    solid = PipeJunctionTable.model_validate(part).solid(Grid(nx=21, ny=21, pitch_um=100.0), Path())
    assert solid.bounds == (-np.inf, np.inf, -np.inf, np.inf)


def assert_is_the_pipes(job: Job) -> None:
    """The region of ink A is the part."""
    assert job.region is not None
    x, y = cell_centers(21, 21, PITCH)
    for z in np.random.default_rng(0).uniform(-5e-6, 65e-6, (20, 21, 21)):
        np.testing.assert_array_equal(job.region.contains(x, y, z), PIPES.contains(x, y, z))


def test_part_with_overhangs_is_refused_with_all_that_can_be_done(tmp_path: Path) -> None:
    bottom, _ = ends()
    x, y = cell_centers(21, 21, PITCH)
    bored = np.minimum(np.abs(x - MIDDLE), np.abs(y - MIDDLE)) < 4.0e-4
    hanging = (bottom > 1e-9) | bored & np.isfinite(bottom)
    with pytest.raises(ScenarioError) as caught:
        loaded(tmp_path, None)
    (error,) = (text for text in caught.value.errors if "hang" in text)
    endless = "part reaches beyond the grid of 21 x 21 cells: it has no end; add [support]"
    assert [text for text in caught.value.errors if text.startswith(endless)]
    cells, share, rest = re.search(r"(\d+) cells \(([\d.]+)%\) .* substrate \((\d+) cells\)", error).groups()
    assert int(cells) == hanging.sum()
    assert float(share) == pytest.approx(100 * hanging.sum() / np.isfinite(bottom).sum(), rel=1e-2, abs=0.0)
    assert int(rest) == (bottom <= 1e-9).sum()
    i, j = np.argwhere(hanging)[0]
    assert f"first at ({i}, {j}) from 30 µm, up to 32 µm of air" in error  # the side of a pipe; a bore
    for kind in ("below-overhangs", "around", "none"):
        assert f'"{kind}"' in error


def test_support_below_overhangs_reaches_up_to_the_part_and_the_part_is_whole(tmp_path: Path) -> None:
    """The region of ink A is the part itself; cells that no part is over stay empty."""
    job, (bottom, top) = loaded(tmp_path, "below-overhangs").job(), ends()
    inside = np.zeros((21, 21), np.bool_)
    inside[2:-2, 2:-2] = True
    np.testing.assert_array_equal(job.mask, inside & np.isfinite(bottom))
    np.testing.assert_allclose(job.target_height[job.mask], top[job.mask], rtol=1e-6)
    assert not job.target_height[~job.mask].any()
    assert_is_the_pipes(job)
    assert len(job.inks) == 2


def test_support_around_the_part_fills_the_block(tmp_path: Path) -> None:
    text = TEXT.replace("ny = 21", "ny = 25") + "[support]\nmargin_cells = 3\n"
    expected = np.zeros((21, 25), np.bool_)
    expected[3:18, 3:22] = True
    np.testing.assert_array_equal(Scenario.of_text(text, "pipes.toml").job().mask, expected)
    for kind in ("around", None):
        path = tmp_path / "around.toml"
        path.write_text(TEXT + "[support]\n" + ('kind = "around"\n' if kind else ""))
        job = Scenario.load(path).job()
        assert int(job.mask.sum()) == 17 * 17
        np.testing.assert_allclose(job.target_height[job.mask], 60e-6, rtol=1e-12)
        assert_is_the_pipes(job)


def test_ink_a_goes_on_where_it_reaches_the_substrate_or_the_target_within_the_rounding_of_a_mesh() -> None:
    """Of 0.1 um; what begins so near below the target is none of it."""
    near, far, top = 5e-8, 2e-7, 30e-6
    ends = np.array([near, far, top - near]), np.array([top - near, top - far, top + 1e-6])
    found = _without_ends(Columns(1, 3, PITCH, np.arange(4), *ends), np.full((1, 3), top))
    assert found.offsets.tolist() == [0, 1, 2, 2]
    assert (found.bottoms.tolist(), found.tops.tolist()) == ([-1.0, far], [1.0, top - far])


def test_second_ink_is_that_of_the_file_or_the_default() -> None:
    own, other = InkTable(h1_um=3.0), InkTable(h1_um=5.0)
    assert inks_of(Inks(a=own), 1) == (own.ink,)
    assert inks_of(Inks(a=own), 2) == (own.ink, InkTable().ink)
    assert inks_of(Inks(a=own, b=other), 1) == inks_of(Inks(a=own, b=other), 2) == (own.ink, other.ink)


def test_every_droplet_of_a_supported_print_is_of_the_ink_that_belongs_there(tmp_path: Path) -> None:
    run = print_part(loaded(tmp_path, "below-overhangs")).dataset
    (bottom, _), job = ends(), loaded(tmp_path, "below-overhangs").job()
    first = run.pattern.values[1]
    layer = sum(ink.layer_height for ink in job.inks) / 2
    np.testing.assert_array_equal(first[job.mask] == 2, (bottom > layer / 2)[job.mask])
    assert not first[~job.mask].any()


def test_without_support_only_what_rests_on_the_substrate_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mushroom = Solid(Mushroom(), Bounds(1e-3, 1e-3, 1e-3, 1e-3))
    monkeypatch.setattr(PipeJunctionTable, "solid", lambda table, grid, folder: mushroom)
    with pytest.raises(
        ScenarioError, match=r"part: 72 cells \(88\.9%\) have nothing below them, first at \(6, 6\) from 20 µm"
    ):
        loaded(tmp_path, None)
    job = loaded(tmp_path, "none").job()
    assert int(job.mask.sum()) == 9
    assert (job.target_height[job.mask] == 60e-6).all()
    assert job.region is None
    assert len(job.inks) == 1


def test_part_of_which_nothing_rests_on_the_substrate_needs_ink_b(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cap = Solid(Cap(), Bounds(1e-3, 1e-3, 1e-3, 1e-3))
    monkeypatch.setattr(PipeJunctionTable, "solid", lambda table, grid, folder: cap)
    for support in (None, "none"):
        with pytest.raises(ScenarioError, match=r"81 cells \(100\.0%\) have nothing below .* print ink B there$"):
            loaded(tmp_path, support)
    job = loaded(tmp_path, "below-overhangs").job()
    assert int(job.mask.sum()) == 81
    assert (job.target_height[job.mask] == 60e-6).all()


class Mushroom:
    """A stem of 3 x 3 cells under a cap of 9 x 9, which begins at 20 um; both end at 60 um."""

    height = 60e-6

    def contains(self, x: Any, y: Any, z: Any) -> Any:
        return contained(self.intervals(x, y), z)

    def intervals(self, x: Any, y: Any) -> Any:
        far = np.maximum(np.abs(x - MIDDLE), np.abs(y - MIDDLE))
        bottom = np.where(far < 1.5 * PITCH, 0.0, np.where(far < 4.5 * PITCH, 20e-6, np.inf))
        return ((bottom, np.full_like(x, 60e-6)),)

    def top(self, x: Any, y: Any) -> Any:
        return np.full_like(x, 60e-6)


class Cap(Mushroom):
    """The cap alone."""

    def intervals(self, x: Any, y: Any) -> Any:
        ((bottom, top),) = super().intervals(x, y)
        return ((np.maximum(bottom, 20e-6), top),)


def height(nx: int, ny: int, seed: int = 1, **keys: Any) -> np.ndarray:
    return SubstrateTable(**keys).height(nx, ny, 250e-6, seed)


def test_tilt_step_and_wave_have_their_size_over_the_lowest_cell() -> None:
    assert height(7, 6, tilt_x=0.01, step_um=-30.0, wave_um=5.0, roughness_um=2.0).min() == 0.0
    tilted = height(5, 4, tilt_x=0.01, tilt_y=-0.02)
    np.testing.assert_allclose(np.diff(tilted, axis=0), 0.01 * 250e-6)
    np.testing.assert_allclose(np.diff(tilted, axis=1), -0.02 * 250e-6)
    np.testing.assert_allclose(height(6, 2, step_um=30.0)[:, 0], [0.0] * 3 + [30e-6] * 3, rtol=1e-12)
    np.testing.assert_allclose(height(5, 2, step_um=30.0)[:, 0], [0.0] * 3 + [30e-6] * 2, rtol=1e-12)
    wave = height(9, 5, wave_um=5.0, wavelength_um=7.3 * 250e-6 * 1e6)
    along_x, along_y = (np.cos(2.0 * np.pi * np.arange(-cells, cells + 1) / 7.3) for cells in (4, 2))
    np.testing.assert_allclose(wave - wave[4, 2], 5e-6 * (np.outer(along_x, along_y) - 1.0), rtol=0.0, atol=1e-17)


def test_roughness_has_its_standard_deviation_and_follows_the_seed() -> None:
    first, again, other = (height(60, 60, seed, roughness_um=2.0) for seed in (1, 1, 2))
    assert first.std() == pytest.approx(2e-6, rel=0.05, abs=0.0)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_roughness_of_a_file_follows_its_seed() -> None:
    rough = {"substrate.roughness_um": 2.0}
    found = [
        Scenario.load(SCENARIOS / "uneven-start.toml", rough | {"seed": seed}).job().height_start for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])  # type: ignore[arg-type]


def test_print_starts_from_the_substrate_of_the_file() -> None:
    scenario = Scenario.load(SCENARIOS / "uneven-start.toml")
    expected = scenario.job().height_start
    assert expected is not None
    components = scenario.build()
    try:
        outputs = components["printer"].initialize(0, {p.name: p.start_value() for p in components["printer"].inputs})
    finally:
        for component in components.values():
            component.terminate()
    np.testing.assert_array_equal(outputs["height"], expected)
