"""Write the page of a run: style, scripts and content in one file that loads nothing, or as parts that a server sends.

A Content-Security-Policy allows the scripts of the page by their hashes and nothing else: no text in a title, a label
or a scenario can run. Plotly needs styles of its own and pictures that it makes itself.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from inkloop.files import write_text
from inkloop.report.page import maps
from inkloop.report.page.content import content
from inkloop.report.page.devices import devices
from inkloop.report.page.maps import LayerMaps
from inkloop.report.terminal import without_nan
from inkloop.results.result import Result

FILE = "report.html"
SCRIPTS = ("maps.js", "charts.js", "page.js")
"""Scripts of this package, in the order in which they run; Plotly runs before them."""
FILE_BYTES_MAX = 25_000_000
OTHERS_BYTES = 6_500_000
"""Bytes of a file besides the maps: Plotly, 4.8 MB, style, scripts, texts and curves."""
MAPS_BYTES_MAX = FILE_BYTES_MAX - OTHERS_BYTES
PACKED_SHARE = 0.5
"""Bytes in base64 per byte of differences in rough layers (measured); smooth layers have fewer."""


def write(path: Path, runs: Mapping[str, Result], log: Path) -> None:
    """Write one file with runs by name, the run itself first; log: of its devices, if it has any. Raises OSError."""
    write_text(path, standalone({**content_within(runs, MAPS_BYTES_MAX), "devices": devices(log)}))


def content_within(runs: Mapping[str, Result], bytes_max: int) -> dict[str, Any]:
    """The content with the smallest blocks of cells for which all maps take at most so many bytes."""
    cells = maps.FINAL_CELLS / len(runs)
    block = first_block(runs, bytes_max / PACKED_SHARE)
    while True:
        found = content(runs, [LayerMaps(result.dataset, block) for result in runs.values()], cells=cells)
        if bytes_of_maps(found) <= bytes_max:
            return found
        block += 1


def first_block(runs: Mapping[str, Result], bytes_max: float, expected: int = 0) -> int:
    """The smallest side of blocks with which the maps of all layers take so many bytes before they are deflated.

    expected: layers of all runs, where there will be more than now.
    """
    layers = max(expected, sum(result.dataset.sizes["layer"] for result in runs.values()))
    run = next(iter(runs.values())).dataset
    return maps.block_for(run, bytes_max / (layers * maps.BYTES_OF_A_CELL_AND_LAYER))


def bytes_of_maps(content_: Mapping[str, Any]) -> int:
    """The size of all packed arrays of a content."""
    groups = [group for run in content_["runs"] for group in (run, run["layers"], run["final"])]
    return sum(len(array["data"]) for group in groups for array in _arrays(group))


def standalone(content_: Mapping[str, Any]) -> str:
    """The page as one text."""
    scripts = [plotly(), *map(own_file, SCRIPTS)]
    hashes = " ".join(f"'sha256-{_sha256(script)}'" for script in scripts)
    data = f'<script type="application/json" id="content">{as_json(content_)}</script>'
    return _page(f"script-src {hashes}", [data, *(f"<script>{script}</script>" for script in scripts)])


def served() -> str:
    """The page that loads its scripts and its content from its server."""
    sources = ["plotly.js", *SCRIPTS]
    return _page(LIVE_SOURCES, [f'<script src="{source}"></script>' for source in sources])


LIVE_SOURCES = "script-src 'self'; connect-src 'self'"
"""Sources that the live page may load, in addition to `POLICY`."""
POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; style-src 'unsafe-inline'"


def plotly() -> str:
    """The JavaScript of the installed Plotly."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def own_file(name: str) -> str:
    """A file of this package: script, style, or the frame of the page."""
    return files("inkloop.report.page").joinpath(name).read_text(encoding="utf-8")


def as_json(values: Any) -> str:
    """JSON that neither ends nor comments out the script element that it stands in; a number that is none is null."""
    text = json.dumps(without_nan(values), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _page(sources: str, scripts: list[str]) -> str:
    frame, style = own_file("page.html"), own_file("page.css")
    for mark, text in {"policy": f"{POLICY}; {sources}", "style": style, "scripts": "\n".join(scripts)}.items():
        frame = frame.replace(f"<!-- {mark} -->", text, 1)
    return frame


def _arrays(group: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [value for value in group.values() if isinstance(value, dict) and "data" in value and "type" in value]


def _sha256(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
