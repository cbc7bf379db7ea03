"""The loop of real parts prints the same layers with any master and any step."""

from __future__ import annotations

import pytest
import xarray as xr

from support.small_block import SECOND, assert_same_layers, printed


@pytest.fixture(scope="module")
def reference() -> xr.Dataset:
    return printed()


@pytest.mark.parametrize(("horizon", "layers_max"), [(1, 8), (3, 10)])
def test_block_reaches_its_height(horizon: int, layers_max: int) -> None:
    run = printed(horizon=horizon)
    assert 4 <= run.sizes["layer"] - 1 <= layers_max
    assert abs(float(run.mean_error[-1])) < 1e-6


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("step_ns", [SECOND // 7, SECOND, 13 * SECOND])
def test_same_layers_from_any_master_and_step(reference: xr.Dataset, algorithm: str, step_ns: int) -> None:
    assert_same_layers(printed(algorithm=algorithm, step_ns=step_ns), reference)


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_same_layers_however_long_printing_and_scanning_take(reference: xr.Dataset, algorithm: str) -> None:
    assert_same_layers(printed(algorithm=algorithm, duration_s=2.0, scan_s=6.0), reference)


@pytest.mark.parametrize("fmi", ["fmi3-fixed", "fmi2"])
def test_same_layers_from_every_form_of_the_fmus(reference: xr.Dataset, fmi: str) -> None:
    assert_same_layers(printed(fmi=fmi), reference)
