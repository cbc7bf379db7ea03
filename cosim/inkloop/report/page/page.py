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

from plotly.offline import get_plotlyjs

from inkloop.files import write_text
from inkloop.report.page import maps
from inkloop.report.page.content import content
from inkloop.report.page.maps import LayerMaps
from inkloop.report.terminal import without_nan
from inkloop.results.result import Result

FILE = "report.html"
SCRIPTS = ("maps.js", "page.js")
"""Scripts of this package, in the order in which they run; Plotly runs before them."""
FILE_BYTES_MAX = 25_000_000
OTHERS_BYTES = 6_500_000
"""Bytes of a file besides the content: Plotly, 4.8 MB, style and scripts, with room for later versions."""
CONTENT_BYTES_MAX = FILE_BYTES_MAX - OTHERS_BYTES
PACKED_SHARE = 0.5
"""Bytes in base64 per byte of differences in rough layers (measured); smooth layers have fewer."""
POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; style-src 'unsafe-inline'"
LIVE_SOURCES = "script-src 'self'; connect-src 'self'"
"""Sources that the live page may load, in addition to `POLICY`."""


def write(path: Path, runs: Mapping[str, Result], log: Path) -> None:
    """Write one file with runs by name, the run itself first; log: of its devices, if it has any. Raises OSError."""
    write_text(path, standalone(content_within(runs, log, CONTENT_BYTES_MAX)))


def content_within(runs: Mapping[str, Result], log: Path, bytes_max: int) -> str:
    """The content as JSON, with the smallest blocks of cells for which it is so short."""
    grid = next(iter(runs.values())).dataset.sizes
    block, text = first_block(runs, bytes_max / PACKED_SHARE), ""
    while not text or (len(text) > bytes_max and block <= max(grid["x"], grid["y"])):
        text = as_json(content(runs, [LayerMaps(result.dataset, block) for result in runs.values()], log))
        block += 1
    return text


def first_block(runs: Mapping[str, Result], bytes_max: float, expected: int = 0) -> int:
    """The smallest side of blocks with which the maps of all layers take so many bytes before they are deflated.

    expected: layers of all runs, where there will be more than now.
    """
    layers = max(expected, sum(result.dataset.sizes["layer"] for result in runs.values()))
    run = next(iter(runs.values())).dataset
    return maps.block_for(run, bytes_max / (layers * maps.BYTES_OF_A_CELL_AND_LAYER))


def standalone(content_: str) -> str:
    """The page as one text; content_: JSON."""
    scripts = [get_plotlyjs(), *map(own_file, SCRIPTS)]
    hashes = " ".join(f"'sha256-{_sha256(script)}'" for script in scripts)
    data = f'<script type="application/json" id="content">{content_}</script>'
    return _page(f"script-src {hashes}", [data, *(f"<script>{script}</script>" for script in scripts)])


def served() -> dict[str, str]:
    """The page that loads its scripts and its content from its server, at `/`, and its scripts by their paths."""
    scripts = {"/plotly.js": get_plotlyjs(), **{f"/{name}": own_file(name) for name in SCRIPTS}}
    return {"/": _page(LIVE_SOURCES, [f'<script src="{path[1:]}"></script>' for path in scripts]), **scripts}


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


def _sha256(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
