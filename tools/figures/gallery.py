"""Run every scenario and draw one picture of each: `make gallery`. Names as arguments: only those scenarios are run."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from inkloop.bench.emulation import emulation_of
from inkloop.cli import main
from inkloop.components.devices import KINDS
from inkloop.files import write_text
from inkloop.report import run_report
from inkloop.results.result import COMPARE_FOLDER
from inkloop.scenario.file import Scenario
from inkloop_hardware.emulated_bench import EmulatedBench

ROOT = Path(__file__).parents[2]
HERE = ROOT / "docs" / "gallery"
SCENARIOS = ROOT / "scenarios"
BUILD = ROOT / "build" / "gallery"
COMPARISON = "compare"
"""Used instead of a picture name: the run compared with its comparison runs."""

PICTURES = {
    "bench": "cross-section",
    "cuboid": COMPARISON,
    "cylinder-open-loop": "cross-section",
    "drifting-ink": "cross-section",
    "four-passes": COMPARISON,
    "grey-head": COMPARISON,
    "noisy-sensor": COMPARISON,
    "pipe-junction": "solid",
    "roller": COMPARISON,
    "staircase": "cross-section",
    "tall-cylinder": "layers",
    "tilted-substrate": "cross-section",
    "two-materials": "materials",
    "uneven-start": "cross-section",
}
DEFAULT_PICTURE = "open-against-closed"
HEAD = """\
# Gallery

`make gallery` prints every file of [scenarios/](../../scenarios/) and writes this page from the comment at the top of
each file.
"""


def draw(path: Path) -> None:
    """Run one scenario and copy its picture next to the page."""
    folder = BUILD / path.stem
    shutil.rmtree(folder, ignore_errors=True)
    with bench_of(path) as arguments:
        if main(["run", str(path), "--out", str(folder), *arguments]) != 0:
            raise SystemExit(f"{path}: did not print")
    picture = HERE / f"{path.stem}.png"
    name = PICTURES.get(path.stem, DEFAULT_PICTURE)
    if name == COMPARISON:
        run_report.compare([folder, *sorted((folder / COMPARE_FOLDER).iterdir())], picture)
    else:
        shutil.copyfile(folder / f"{name}.png", picture)


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


def entry(path: Path) -> str:
    """Title, the comment on top of the file as text, and the picture."""
    scenario = Scenario.load(path)
    comment = path.read_text(encoding="utf-8").split("title =")[0]
    text = "\n".join(line.removeprefix("#").strip() for line in comment.splitlines()).strip()
    title = scenario.tables.title
    return f"\n## {title}\n\n[{path.name}](../../scenarios/{path.name}): {text}\n\n![{title}]({path.stem}.png)\n"


if __name__ == "__main__":
    scenarios = sorted(SCENARIOS.glob("*.toml"))
    names = sys.argv[1:] or [path.stem for path in scenarios]
    for name in names:
        draw(SCENARIOS / f"{name}.toml")
    write_text(HERE / "README.md", HEAD + "".join(entry(path) for path in scenarios))
    sys.stdout.write(f"wrote {HERE / 'README.md'}\n")
