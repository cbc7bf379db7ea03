"""Pages as tests read them: their content, and their maps unpacked without the code of the page."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.printing.print import Print
from inkloop.printing.run import origin_of
from inkloop.results.recorder import LayerRow
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario

HOSTILE = "<script>document.title = 'run'</script><b>&amp;"


class Stopped(Exception):
    """Ends a print as a crash does: nothing is saved but its layers."""


def content_of(page: str) -> Any:
    """The content of a page, from its text."""
    found = re.search(r'<script type="application/json" id="content">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def unpacked(packed: dict[str, Any]) -> NDArray[Any]:
    """An array of a page."""
    data = zlib.decompress(base64.b64decode(packed["data"]))
    return np.frombuffer(data, np.dtype(packed["type"]).newbyteorder("<")).reshape(packed["shape"])


def heights_of(run: dict[str, Any]) -> NDArray[np.float64]:
    """Heights by layer of a run in a content that holds all of its layers [um]."""
    assert run["layers"]["first"] == 0
    steps = np.cumsum(unpacked(run["layers"]["heights"]).astype(np.int64), axis=0)
    return np.asarray(steps * run["step_um"])


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
