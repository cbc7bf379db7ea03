"""Content of a page for a run and its comparison runs, as plain values for JSON: texts, tables, figures and maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from inkloop.metrology.evaluation.table import PRINTED_UNITS, Parameter, evaluate
from inkloop.metrology.evaluation.treatment import Evaluation
from inkloop.report.page import curves, maps
from inkloop.report.page.maps import LayerMaps
from inkloop.report.run_report import CAPTION, Summary, grid
from inkloop.results.evaluated_surface import parameters_of, subject_of
from inkloop.results.result import Result

PARAMETERS = ("Sa", "Sq", "Sp", "Sv", "Sz", "Ssk", "Sku", "Sdq", "Sdr")
"""Parameters of ISO 25178-2 that need no filter and no shape of the part."""
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
    runs: Mapping[str, Result], layer_maps: Sequence[LayerMaps], known: Sequence[int] = (), cells: float = 0.0
) -> dict[str, Any]:
    """The content of a page for runs by name, the run itself first.

    layer_maps: of each run; known: layers of each run that the page already has; cells: of each final error
    map at most.
    """
    main, summary = next(iter(runs.values())), Summary.of(runs)
    labelled = {name: result.dataset for name, result in runs.items()}
    first = [max(0, min(count, len(own.heights)) - 1) for count, own in zip(known, layer_maps, strict=False)]
    first += [0] * (len(runs) - len(first))
    return {
        "title": str(main.dataset.attrs["title"]),
        "state": state(main),
        "table": _table(summary),
        "remarks": list(summary.remarks),
        "metrology": _metrology(main),
        "facts": _facts(main),
        "scenario": main.scenario_text,
        "curves": curves.by_layer(labelled),
        "distribution": curves.distribution(labelled),
        "runs": [
            {
                "name": name,
                **own.described(run),
                "layers": own.packed(begin),
                "final": maps.final_errors(run, cells),
                "inks": 2 if "mismatch" in run else 1,
            }
            for (name, run), own, begin in zip(labelled.items(), layer_maps, first, strict=True)
        ],
    }


def state(result: Result) -> str:
    """Progress of a run, in one sentence."""
    layers = result.dataset.sizes["layer"] - 1
    return f"{ENDS.get(result.stop_reason, result.stop_reason)}: {layers} layer{'' if layers == 1 else 's'}."


def _table(summary: Summary) -> dict[str, Any]:
    headings = [" ".join(heading.replace("-\n", "").split()) for heading in summary.headings]
    return {"headings": headings, "rows": summary.rows, "caption": CAPTION}


def _metrology(main: Result) -> dict[str, Any]:
    """The parameters of the last surface over the part that `[metrology]` asked for, else the common ones."""
    run, wanted = main.dataset, Evaluation(PARAMETERS)
    held = parameters_of(run)
    shown = held or evaluate(subject_of(run, "last layer"), wanted)
    treatment = run[held[0].symbol].attrs["treatment"] if held else str(wanted.treatment)
    rows = [[parameter.symbol, parameter.name, _value(parameter)] for parameter in shown]
    return {"rows": rows, "caption": f"last layer, over the part; {treatment}"}


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
