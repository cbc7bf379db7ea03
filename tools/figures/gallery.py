"""Run every scenario, draw one picture of each, keep the figures of its runs, and write them into pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tools.figures.pages import DOCS, ROOT, Texts, block, read_json, write_json

from inkloop.bench.commands import emulation_of
from inkloop.cli import main
from inkloop.components.devices import KINDS
from inkloop.report import PNG, run_report
from inkloop.results.result import COMPARE_FOLDER, Result
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M
from inkloop_hardware.emulated_bench import EmulatedBench

HERE = DOCS / "gallery"
RECORD = HERE / "runs.json"
SCENARIOS = ROOT / "scenarios"
BUILD = ROOT / "build" / "gallery"
COMPARISON = "compare"
"""Used instead of a picture name: the run compared with its comparison runs."""

PICTURES = {
    "bench": "cross-section",
    "casadi": COMPARISON,
    "cuboid": COMPARISON,
    "cylinder-open-loop": "cross-section",
    "drifting-ink": "cross-section",
    "four-passes": COMPARISON,
    "grey-head": COMPARISON,
    "noisy-sensor": COMPARISON,
    "pipe-junction": "solid",
    "pipe-junction-3mf": "solid",
    "roller": COMPARISON,
    "staircase": "cross-section",
    "tall-cylinder": "layers",
    "tilted-substrate": "cross-section",
    "two-ink-3mf": "materials",
    "two-materials": "materials",
    "uneven-start": "cross-section",
}
DEFAULT_PICTURE = "open-against-closed"
LOOK_AT = "What to look at: "
"""Begins the second part of a comment; the page shows what follows."""


def run(*names: str) -> None:
    """Run these scenarios, or all, and keep their figures; those of files that are gone are dropped."""
    paths = sorted(SCENARIOS.glob("*.toml"))
    record = read_json(RECORD) if RECORD.exists() else {}
    for path in paths:
        if not names or path.stem in names:
            record[path.stem] = measured(draw(path))
            write_json(RECORD, {each.stem: record[each.stem] for each in paths if each.stem in record})


def draw(path: Path) -> Mapping[str, Result]:
    """Run one scenario and copy its picture next to the page; its runs by label."""
    folder = BUILD / path.stem
    shutil.rmtree(folder, ignore_errors=True)
    with bench_of(path) as arguments:
        if main(["run", str(path), "--out", str(folder), *arguments]) != 0:
            raise SystemExit(f"{path}: did not print")
    picture = HERE / f"{path.stem}.png"
    name = PICTURES.get(path.stem, DEFAULT_PICTURE)
    if name == COMPARISON:
        run_report.compare([folder, *sorted((folder / COMPARE_FOLDER).iterdir())], picture, [PNG])
    else:
        shutil.copyfile(folder / f"{name}.png", picture)
    runs, compare = run_report.load_runs(folder), Scenario.load(path).tables.compare
    return {label: runs[label] for label in (next(iter(runs)), *compare)}


@contextmanager
def bench_of(path: Path) -> Iterator[list[str]]:
    """Run the emulator for a scenario that prints on devices; yields the arguments of `inkloop run` that select it."""
    scenario = Scenario.load(path)
    if not any(table.kind in KINDS for table in scenario.tables.components.values()):
        yield []
        return
    emulation = emulation_of(scenario)
    with EmulatedBench(emulation.parameters, surface=emulation.surface) as bench:
        yield ["--set", f"bench.channel={bench.channel}"]


def measured(runs: Mapping[str, Result]) -> dict[str, Any]:
    """Seed and figures of each run."""
    seed = int(next(iter(runs.values())).dataset.attrs["seed"])
    return {"seed": seed, "runs": {label: figures(run) for label, run in runs.items()}}


def figures(run: Result) -> dict[str, float]:
    """Errors over the part [um], mismatch [%], layers and droplets of a run."""
    metrics = run.metrics()
    found = {f"{key}_um": round(metrics[key] * UM_PER_M, 4) for key in ("mean_error", "mae", "std")}
    mismatch = {"mismatch_percent": round(metrics["mismatch"] * 100.0, 3)} if "mismatch" in metrics else {}
    return {**found, **mismatch, "layers": int(metrics["layers"]), "droplets": int(metrics["droplets"])}


def texts() -> Texts:
    """The entries of the page, from the scenarios and the record, and the errors of the part of the tutorial."""
    record = read_json(RECORD)
    entries = (entry(path, record[path.stem]) for path in sorted(SCENARIOS.glob("*.toml")))
    return {
        HERE / "README.md": {"scenarios": block(["", *entries])},
        DOCS / "tutorial/print-your-own-part.md": {"bracket": errors(record["bracket"])},
    }


def entry(path: Path, record: Mapping[str, Any]) -> str:
    """Title, the comment on top of the file as text, figures that its picture does not show, and the picture."""
    figures = "" if PICTURES.get(path.stem, COMPARISON) == COMPARISON else f"Error: {errors(record)}.\n\n"
    link = f"[{path.name}](../../scenarios/{path.name})"
    title = Scenario.load(path).tables.title
    return f"## {title}\n\n{link}: {comment(path)}\n\n{figures}![{path.stem}]({path.stem}.png)\n"


def errors(record: Mapping[str, Any]) -> str:
    """The errors of each run of a scenario, as a list within a sentence."""
    return "; ".join(f"{label} {shown(each)}" for label, each in record["runs"].items())


def shown(run: Mapping[str, float]) -> str:
    """Mean error and standard deviation of a run, and the mismatch of two inks."""
    mismatch = f" (mismatch {run['mismatch_percent']:.1f} %)" if "mismatch_percent" in run else ""
    return f"{run['mean_error_um']:z.2f} ± {run['std_um']:.2f} µm{mismatch}"


def comment(path: Path) -> str:
    """The comment on top of a scenario as text."""
    lines = path.read_text(encoding="utf-8").split("title =")[0].splitlines()
    what, _, look_at = "\n".join(line.removeprefix("#").strip() for line in lines).strip().partition(LOOK_AT)
    return f"{what}{look_at[:1].upper()}{look_at[1:]}"
