"""Pages as tests read them: runs, contents, and maps unpacked without the code of the page."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from inkloop.printing.print import Print
from inkloop.printing.run import origin_of
from inkloop.report.page.maps import LayerMaps
from inkloop.report.page.page import content
from inkloop.results.recorder import LayerRow
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario

HOSTILE = "<script>document.title = 'run'</script><b>&amp;"


MASK = np.zeros((12, 9), np.bool_)
MASK[2:10, 1:8] = True
TARGET = np.where(MASK, 20e-6, 0.0)
HEIGHT = np.where(MASK, 20e-6 + np.random.default_rng(3).normal(0.0, 1e-6, MASK.shape), 0.0)
PATTERN = np.zeros((3, 12, 9), np.int32)
PATTERN[1:, 2:10, 1:4], PATTERN[1:, 2:10, 5:8] = 1, 2


def plate(label: str = "closed loop", **more: Any) -> Result:
    """A plate of two layers in two inks on a grid that is not square; more: variables, or None to leave one out."""
    variables = {
        "height": (("layer", "x", "y"), np.stack([0.0 * HEIGHT, HEIGHT / 2, HEIGHT])),
        "pattern": (("layer", "x", "y"), PATTERN),
        "target_height": (("x", "y"), TARGET),
        "mask": (("x", "y"), MASK),
        "mean_error": ("layer", [20e-6, 10e-6, 1e-7]),
        "std": ("layer", [0.0, 5e-7, 1e-6]),
        "mismatch": 0.25,
    } | more
    places = {"layer": np.arange(3), "x": np.arange(12) * 1e-4, "y": np.arange(9) * 1e-4}
    kept = {name: values for name, values in variables.items() if values is not None}
    return Result.of(
        xr.Dataset(kept, places, {"pitch": 1e-4}), title="Plate", label=label, scenario_text="title = 'Plate'\n",
        seed=11, stop_reason="layers_max", wall_s={"total": 2.345}, components={},
        notes={"events": ["layer 1: nozzle 5 is dead"]},
    )  # fmt: skip


def shown(*runs: Result, block: int = 1, log: Path = Path("none.log"), known: Sequence[int] = ()) -> dict[str, Any]:
    """The content of a page of runs, whose maps are in blocks."""
    named = {result.dataset.attrs["label"]: result for result in runs}
    return content(named, [LayerMaps(result.dataset, block) for result in runs], log, known)


class Stopped(Exception):
    """Ends a print as a crash does: nothing is saved but its layers."""


def content_of(page: str) -> Any:
    """The content of a page, from its text."""
    found = re.search(r'<script type="application/json" id="content">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def unpacked(packed: dict[str, Any]) -> NDArray[Any]:
    """Maps (..., nx, ny) of a page."""
    data = zlib.decompress(base64.b64decode(packed["data"]))
    rows = np.frombuffer(data, np.dtype(packed["type"]).newbyteorder("<")).reshape(packed["shape"])
    return rows.swapaxes(-1, -2)


def heights_of(run: dict[str, Any]) -> NDArray[np.float64]:
    """Heights by layer of a run in a content that holds all of its layers [um]."""
    assert run["layers"]["first"] == 0
    steps = np.cumsum(unpacked(run["layers"]["heights"]).astype(np.int64), axis=0)
    return np.asarray(steps * run["step"])


def unfinished(path: Path, folder: Path, layers: int) -> None:
    """Print a scenario, and leave its folder as a crash after so many layers does."""
    scenario = Scenario.load(path)
    Result.begin(folder, scenario.text, origin_of(scenario, compare=False))

    def stop(row: LayerRow) -> None:
        if row.layer > layers:
            raise Stopped

    try:
        Print(scenario, folder, on_layer=stop).run()
    except Stopped:
        return
    raise AssertionError(f"the print had no more than {layers} layers")
