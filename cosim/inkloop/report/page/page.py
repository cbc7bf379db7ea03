"""The page of a run: its content as plain values, in one file that loads nothing, or as parts that a server sends.

A Content-Security-Policy allows the scripts of the page by their hashes and nothing else: no text in a title, a label
or a scenario can run. Plotly needs styles of its own and pictures that it makes itself.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import xarray as xr
from plotly.offline import get_plotlyjs

from inkloop.files import regular, write_text
from inkloop.metrology.evaluation.definitions import Evaluation, Treatment
from inkloop.metrology.evaluation.table import Parameter, evaluate
from inkloop.report.page import charts, curves, maps
from inkloop.report.page.maps import LayerMaps
from inkloop.report.run_report import CAPTION, Summary, grid
from inkloop.report.terminal import without_nan
from inkloop.results.result import Result
from inkloop.results.surface import parameters_of, subject_of

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
PARAMETERS = ("Sa", "Sq", "Sp", "Sv", "Sz", "Ssk", "Sku", "Sdq", "Sdr")
"""Parameters of ISO 25178-2 that need no filter and no shape of the part."""
LOG_LINES = 40
"""Number of last lines of a log of devices that a page shows."""
ENDS = {
    "done": "The controller ended the print",
    "layers_max": "The print ended at `layers_max` of the scenario",
    "time_max": "The print ended at `time_max_s` of the scenario",
    "interrupted": "The print was interrupted",
    "stopped": "The controller stopped the print, as the scans do not show what was printed",
    "failed": "A component failed",
    "fault": "The print ended with a fault",
    "running": "The print has not ended",
}
"""Stop reason -> a sentence about it."""


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


def content(
    runs: Mapping[str, Result], layer_maps: Sequence[LayerMaps], log: Path, known: Sequence[int] = ()
) -> dict[str, Any]:
    """The content of a page for runs by name, the run itself first.

    layer_maps: of each run; log: of its devices, a file that may not exist; known: layers of each run that the page
    already has.
    """
    main, summary = next(iter(runs.values())), Summary.of(runs)
    labelled = {name: result.dataset for name, result in runs.items()}
    errors = {name: curves.final_error(run) for name, run in labelled.items()}
    scale = charts.ErrorScale.of(list(errors.values()))
    first = [max(0, min(count, len(own.heights)) - 1) for count, own in zip(known, layer_maps, strict=False)]
    first += [0] * (len(runs) - len(first))
    nodes = _devices(log)
    return {
        "texts": {
            "title": str(main.dataset.attrs["title"]),
            "state": state(main),
            "scenario": main.scenario_text,
            "log": "\n".join(nodes["log"]) if nodes else "",
        },
        "tables": {
            "table": _table(summary),
            "metrology": _metrology(main),
            "facts": {"rows": _facts(main)},
        }
        | ({"nodes": nodes} if nodes else {}),
        "remarks": list(summary.remarks),
        "template": charts.TEMPLATE.to_plotly_json(),
        "width": scale.width,
        "curves": charts.values(curves.by_layer(labelled)),
        "distribution": charts.values(curves.distribution(errors)),
        "runs": [
            _run(name, run, own, begin, scale, maps.FINAL_CELLS / len(runs))
            for (name, run), own, begin in zip(labelled.items(), layer_maps, first, strict=True)
        ],
    }


def _run(
    name: str, run: xr.Dataset, own: LayerMaps, first: int, scale: charts.ErrorScale, cells: float
) -> dict[str, Any]:
    """Maps and charts of a run; cells: of its final error map at most."""
    inks = 2 if "mismatch" in run else 1
    described, final = own.described(run), maps.final_errors(run, cells)
    planned = -(-int(own.planned.max(initial=0)) // maps.TENTHS)
    shown = charts.of_run(name, scale, own.range_um, described["edges"], inks if own.blocks.block == 1 else 0, planned)
    return {"name": name, "inks": inks, **described, "layers": own.packed(first), "final": final, "charts": shown}


def state(result: Result) -> str:
    """Progress of a run, in one sentence."""
    layers = result.dataset.sizes["layer"] - 1
    return f"{ENDS.get(result.stop_reason, result.stop_reason)}: {layers} layer{'' if layers == 1 else 's'}."


def _table(summary: Summary) -> dict[str, Any]:
    headings = [" ".join(heading.replace("-\n", "").split()) for heading in summary.headings]
    return {"headings": headings, "rows": summary.rows, "caption": CAPTION, "words": 1}


def _metrology(main: Result) -> dict[str, Any]:
    """The parameters of the last surface over the part that `[metrology]` asked for, else the common ones."""
    run, wanted = main.dataset, Evaluation(PARAMETERS, Treatment("target"))
    held = parameters_of(run)
    shown = held or evaluate(subject_of(run, "last layer"), wanted)
    treatment = run[held[0].symbol].attrs["treatment"] if held else str(wanted.treatment)
    rows = [[parameter.symbol, parameter.name, _value(parameter)] for parameter in shown]
    return {"rows": rows, "caption": f"last layer, over the part; {treatment}", "words": 2}


def _value(parameter: Parameter) -> str:
    shown = f"{parameter.shown:.4g} {parameter.printed_unit}".rstrip()
    return f"refused: {parameter.reason}" if parameter.reason else shown


def _facts(main: Result) -> list[list[str]]:
    """Seed, versions, hashes and times, as in run.json."""
    run = main.run
    grouped = [(group, run.get(group, {})) for group in ("versions", "sha256", "wall_s")]
    facts = [["seed", str(run["seed"])], ["grid", grid(main)], ["platform", str(run["platform"])]]
    for group, entries in grouped:
        label = {"versions": "version of ", "sha256": "SHA-256 of ", "wall_s": "wall time of "}[group]
        shown = {name: f"{value:.2f} s" if group == "wall_s" else str(value) for name, value in entries.items()}
        facts += [[f"{label}{name}", text] for name, text in shown.items()]
    return facts + [["event", str(event)] for event in run.get("events", ())]


def _devices(log: Path) -> dict[str, Any] | None:
    """A table of the last message of each node in a log of devices, and the last lines; None without a log."""
    try:
        lines = regular(log).read_text(encoding="utf-8", errors="replace").splitlines()
    except FileNotFoundError:
        return None
    nodes: dict[str, list[str]] = {}
    for line in lines:
        day, time, level, message = (*line.split(" ", 3), "", "", "", "")[:4]
        node, separator, words = message.partition(": ")
        if separator and " " not in node:
            nodes[node] = [node, f"{day} {time}", "" if level == "INFO" else level.lower(), words]
    return {"headings": ["node", "time", "", "last message"], "rows": list(nodes.values()), "log": lines[-LOG_LINES:]}
