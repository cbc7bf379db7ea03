"""Parts of any kind in a loop that is none of ours: the ten lines of the page on the controller from Python."""

from __future__ import annotations

import re

import pytest

from inkloop.components.catalog import DEPOSITION_MODELS
from support.places import ROOT

PAGE = ROOT / "docs/how-to/use-the-controller-from-python.md"
CONTROLLERS = ("CohenLipson", "ErrorDiffusion", "LayerMpc", "OpenLoop", "StochasticGreedy")


def loop_of_the_page() -> str:
    (block,) = re.findall(r"```python\n# three_parts\.py\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return str(block)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_any_controller_prints_in_it(controller: str) -> None:
    text = loop_of_the_page().replace('"LayerMpc", job, {"alpha": 0.9}', f'"{controller}", job, {{}}')
    exec(compile(text.replace("mean()) < 3\n", "mean()) < 8\n"), "three_parts.py", "exec"), {})


@pytest.mark.parametrize("plant", DEPOSITION_MODELS)
@pytest.mark.parametrize("order", ["printer, profiler, controller", "profiler, controller, printer"])
def test_any_plant_prints_in_it_in_any_order(plant: str, order: str) -> None:
    text = loop_of_the_page().replace('"LayerDeposition", job, {"variation": 0.2}', f'"{plant}", job, {{}}')
    text = text.replace('{"alpha": 0.9}', '{"alpha": 0.9, "horizon": 2, "annealing_sweeps": 1}')
    if plant == "YoungLaplaceDeposition":  # whose droplets are a twentieth of those that a job takes for granted
        text = text.replace("from inkloop import Job", "from inkloop import Ink, Job")
        text = text.replace("mask=mask)", "mask=mask, inks=(Ink(0.25e-6, 0.036e-6, 0.012e-6),))")
    names = tuple(order.split(", "))
    text = text.replace("parts.items():", f"((name, parts[name]) for name in {names}):")
    text = text.replace("mean()) < 3\n", "mean()) < 8\n")
    values: dict[str, object] = {}
    exec(compile(text, "three_parts.py", "exec"), values)
    assert values["signals"]["layers_printed"] >= 3  # type: ignore[index]
