"""Run every scenario and show one telling picture of each: `make gallery`."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from inkloop import report
from inkloop.cli import main
from inkloop.files import write_text
from inkloop.scenario import Scenario

HERE = Path(__file__).parent
SCENARIOS = HERE.parents[1] / "scenarios"
BUILD = HERE.parents[1] / "build" / "gallery"
COMPARISON = "compare"
"""In place of the name of a picture: the run beside its comparison runs."""

PICTURES = {
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

Every file of [scenarios/](../../scenarios/), printed by `make gallery`, which writes this page from the words on top of
each file.
"""


def show(path: Path) -> str:
    """Run one scenario, put its picture beside this file; its entry of the page."""
    folder = BUILD / path.stem
    if main(["run", str(path), "--out", str(folder)]) != 0:
        raise SystemExit(f"{path}: did not print")
    picture = HERE / f"{path.stem}.png"
    name = PICTURES.get(path.stem, DEFAULT_PICTURE)
    if name == COMPARISON:
        report.compare([folder, *sorted((folder / report.COMPARE_FOLDER).iterdir())], picture)
    else:
        shutil.copyfile(folder / f"{name}.png", picture)
    return entry(path)


def entry(path: Path) -> str:
    """Title, the comment on top of the file as text, and the picture."""
    scenario = Scenario.load(path)
    comment = path.read_text(encoding="utf-8").split("title =")[0]
    words = "\n".join(line.removeprefix("#").strip() for line in comment.splitlines()).strip()
    title = scenario.tables.title
    return f"\n## {title}\n\n[{path.name}](../../scenarios/{path.name}): {words}\n\n![{title}]({path.stem}.png)\n"


if __name__ == "__main__":
    shutil.rmtree(BUILD, ignore_errors=True)
    paths = sorted(SCENARIOS.glob("*.toml"))
    write_text(HERE / "README.md", HEAD + "".join(show(path) for path in paths))
    sys.stdout.write(f"wrote {HERE / 'README.md'}\n")
