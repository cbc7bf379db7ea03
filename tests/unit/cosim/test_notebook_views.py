"""Views of scenarios, results and plans in a notebook."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

import inkloop
from inkloop_controller import Criterion, Estimate, LayerMpc
from support.closed_loop import block
from support.places import SCENARIOS


def rows(html: str) -> dict[str, str]:
    """The table, which must be well-formed."""
    table = ElementTree.fromstring(html)
    return {str(row[0].text): str(row[1].text) for row in table.iter("tr")}


def test_scenario_shows_part_and_components_escaped() -> None:
    found = inkloop.load(SCENARIOS / "cuboid.toml", {"title": "a < b & c"})
    assert isinstance(found, inkloop.Scenario)
    shown = rows(found._repr_html_())
    assert shown["part"] == "64 cells, 22.8 µm high"
    assert shown["controller"] == "LayerMpc, alpha = 0.8"
    assert shown["grid"].startswith("12 x 12 cells, 3.16 x 3.16 mm")
    assert "a &lt; b &amp; c" in found._repr_html_()


def test_result_shows_its_metrics() -> None:
    scenario = {"components.controller.horizon": 1, "components.controller.annealing_sweeps": 0, "run.layers_max": 2}
    result = inkloop.run(SCENARIOS / "cuboid.toml", scenario)
    shown = rows(result._repr_html_())
    assert float(shown["std [µm]"]) == float(f"{result.metrics()['std'] * 1e6:.3g}")
    assert (shown["layers"], shown["ended"], shown["seed"]) == ("2", "layers_max", "1")


def test_plan_shows_each_layer_ahead() -> None:
    job = block(10, 9)
    controller = LayerMpc(job, criterion=Criterion(alpha=1.0), horizon=2)
    plan = controller.plan(Estimate.exact(np.zeros((10, 9)), job.inks), 0, np.zeros((1, 10, 9), np.int32))
    shown = rows(plan._repr_html_())
    assert shown["droplets by layer"] == ", ".join(str(np.count_nonzero(layer)) for layer in plan.plan)
    figure = plan.plot()
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:2] == [f"layer {k}: {np.count_nonzero(plan.plan[k - 1])} droplets" for k in (1, 2)]
    shown_um = np.asarray(figure.axes[2].images[0].get_array(), np.float64)
    np.testing.assert_allclose(shown_um, plan.predicted_height.T * 1e6, rtol=1e-15, atol=0.0)
