"""The search that plans a layer with a stencil of any reach."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller import Criterion, Estimate, LayerMpc
from inkloop_lab.models import LayerDeposition
from inkloop_lab.score.board import load
from inkloop_lab.score.stencil_search import StencilSearch

FAR_UM = (3.0, 0.5, 0.2, 0.3, 0.1, 0.05)


def small_job(target: float, side: int = 9, margin: int = 2) -> Job:
    mask = np.zeros((side, side), np.bool_)
    mask[margin:-margin, margin:-margin] = True
    return Job(side, side, 263.256e-6, target_height=np.where(mask, target, 0.0), mask=mask)


def objective(job: Job, heights: tuple[float, ...], surface: np.ndarray, pattern: np.ndarray) -> float:
    model = LayerDeposition((heights,))
    after = model.layer(model.start(surface), pattern, 1).height[job.mask]
    return float(0.8 * np.abs(job.target_height[job.mask] - after).mean() + 0.2 * after.std())


@pytest.mark.parametrize("heights_um", [(4.4, 0.6, 0.2), FAR_UM], ids=["reach 1", "reach 2"])
def test_no_droplet_more_less_or_moved_is_better(heights_um: tuple[float, ...]) -> None:
    job = small_job(9e-6)
    surface = np.random.default_rng(1).uniform(0.0, 8e-6, (9, 9))
    heights = tuple(height * 1e-6 for height in heights_um)
    found = StencilSearch(job, heights_um=heights_um).pattern(surface, 0)
    assert 0 < found.sum() < job.mask.sum()
    assert not found[~job.mask].any()
    least = objective(job, heights, surface, found)
    cells = [(int(i), int(j)) for i, j in np.argwhere(job.mask)]
    changes = [[cell] for cell in cells]
    changes += [[a, b] for a in cells for b in cells if a < b and max(abs(a[0] - b[0]), abs(a[1] - b[1])) == 1]
    for places in changes:
        tried = found.copy()
        for place in places:
            tried[place] ^= 1
        if len(places) == 1 or tried.sum() == found.sum():
            assert objective(job, heights, surface, tried) >= least - 1e-12


def test_plan_is_as_good_as_that_of_the_controller_one_layer_ahead() -> None:
    """On its model and its objective; to a hundredth of what a droplet adds."""
    job, ratios = small_job(11e-6, side=12), []
    for seed in range(4):
        surface = np.random.default_rng(seed).uniform(0.0, 9e-6, (12, 12))
        ink = (4.4e-6, 0.6e-6, 0.2e-6)
        controller = LayerMpc(job, horizon=1, criterion=Criterion(droplet_std=0.0))
        theirs = controller.plan(Estimate.exact(surface, job.inks), 0, np.zeros((1, 12, 12), np.int32)).pattern
        ours = StencilSearch(job).pattern(surface, 0)
        ratios.append(objective(job, ink, surface, ours) - objective(job, ink, surface, theirs))
    assert max(ratios) < 0.01 * 7.6e-6


def test_nothing_is_printed_where_nothing_gains() -> None:
    job = small_job(5e-6)
    assert not StencilSearch(job).pattern(job.target_height, 3).any()


def test_two_inks_and_wrong_heights_are_refused_with_a_message() -> None:
    job = load("lu").job()
    with pytest.raises(ValueError, match="needs 3, 6 or 10"):
        StencilSearch(job, heights_um=(1.0, 2.0))
    two = Job(9, 9, 263.256e-6, target_height=np.ones((9, 9)), mask=np.ones((9, 9), np.bool_), inks=(Ink(), Ink()))
    with pytest.raises(ValueError, match="2 inks; this controller prints one"):
        StencilSearch(two)
