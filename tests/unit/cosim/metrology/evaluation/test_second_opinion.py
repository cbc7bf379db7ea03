"""SurfaceTopography, which needs full rectangles, agrees with the evaluation on them.

One test: to import the library takes seconds.
"""

from __future__ import annotations

import numpy as np
import pytest

from support.evaluated import STEP, areal, map_of, number, rough, texture


def test_surface_topography_agrees_on_rectangles() -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="needs inkloop[metrology]").Topography
    # its gradients are those of one triangle a square, which does not matter where the map repeats itself
    z = np.pad(rough((40, 30)), ((0, 1), (0, 1)), mode="wrap")
    for f_operation, detrending in {"none": "center", "plane": "height", "form": "curvature"}.items():
        other = topography(z, physical_sizes=(41 * STEP, 31 * STEP), unit="m").detrend(detrending)
        found = areal(map_of(z), f_operation=f_operation)
        assert number(found, "Sq") == pytest.approx(other.rms_height_from_area(), rel=1e-6, abs=0.0)
        if f_operation != "form":
            assert number(found, "Sdq") == pytest.approx(other.rms_gradient(), rel=1e-9, abs=0.0)

    # its bearing area is that of planes between the cells, which does not matter where the surface is smooth
    smooth = texture((4.0, 4.0), (120, 100))
    smooth = smooth - smooth.mean()
    other = topography(smooth, physical_sizes=(120 * STEP, 100 * STEP), unit="m")
    heights = np.linspace(np.quantile(smooth, 0.9, method="hazen"), smooth.max(), 101)
    ratios = np.array([other.bearing_area(height) for height in heights])
    assert ratios[0] == pytest.approx(0.1, rel=0.02, abs=0.0)
    found = areal(map_of(smooth), f_operation="none")
    assert number(found, "Vmp") == pytest.approx(np.trapezoid(ratios, heights), rel=0.03, abs=0.0)
