"""Content of a page for a run and its comparison runs, as plain values for JSON: texts, tables, figures and maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from inkloop.metrology.evaluation.table import PRINTED_UNITS, Parameter, evaluate
from inkloop.metrology.evaluation.treatment import Evaluation
from inkloop.report.page import charts, curves, maps
from inkloop.report.page.maps import LayerMaps
from inkloop.report.run_report import CAPTION, Summary, grid
from inkloop.results.evaluated_surface import parameters_of, subject_of
from inkloop.results.result import Result

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
    shown = charts.of_run(name, scale, own.range_um, described["edges"], inks if own.blocks.block == 1 else 0)
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
    run, wanted = main.dataset, Evaluation(PARAMETERS)
    held = parameters_of(run)
    shown = held or evaluate(subject_of(run, "last layer"), wanted)
    treatment = run[held[0].symbol].attrs["treatment"] if held else str(wanted.treatment)
    rows = [[parameter.symbol, parameter.name, _value(parameter)] for parameter in shown]
    return {"rows": rows, "caption": f"last layer, over the part; {treatment}", "words": 2}


def _value(parameter: Parameter) -> str:
    unit = "" if parameter.shown_unit == "1" else PRINTED_UNITS.get(parameter.shown_unit, parameter.shown_unit)
    return f"refused: {parameter.reason}" if parameter.reason else f"{parameter.shown:.4g} {unit}".rstrip()


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
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except FileNotFoundError:
        return None
    nodes: dict[str, list[str]] = {}
    for line in lines:
        day, time, level, message = (*line.split(" ", 3), "", "", "", "")[:4]
        node, separator, words = message.partition(": ")
        if separator and " " not in node:
            nodes[node] = [node, f"{day} {time}", "" if level == "INFO" else level.lower(), words]
    return {"headings": ["node", "time", "", "last message"], "rows": list(nodes.values()), "log": lines[-LOG_LINES:]}
