"""Pages the-papers.md and score-board.md: runs `inkloop reproduce` and `inkloop score`, in build/figures.

All figures of a paper are in a CSV file beside the page; the page has those that are not reproduced.
"""

from __future__ import annotations

import csv
import io
import re
import shutil
from pathlib import Path

from tools.figures.pages import DOCS, ROOT, Texts, table

from inkloop.cli import main
from inkloop.files import write_text
from inkloop_lab.reproduce.comparison import HEADINGS

HERE = DOCS / "reference"
RECORDS = HERE / "papers"
INKS = re.compile(r"Ink assumed by each controller.*\n\n(?:\|.*\n)+\n?")
BUILD = ROOT / "build" / "figures"
PAPERS = {
    "lu": ("edges-shrink", "spacing", "cylinder-20", "pipe-junction"),
    "wu-chiu": ("pattern-errors",),
    "hume-rosen": ("droplet-errors", "line-on-a-step", "square", "square-walls"),
}
"""Paper -> pictures that the page shows."""

SCORE_PAGE = """# The score board

    inkloop score                          # our controllers and the baselines on all plants
    inkloop score module:Class             # also your own controller
    inkloop score env:module:Policy        # also a policy, e.g. a learned one
    inkloop score module:Class --set limit=0.5 --plant lu --quick --out DIR

Each plant is a file of [plant-v1](../../lab/inkloop_lab/score/plant-v1) or
[plant-v2](../../lab/inkloop_lab/score/plant-v2) (displaced, incomplete scans). A version never changes: tables with the
same hash (after "plants") can be compared. A class is that [of a scenario](../how-to/bring-your-own-component.md), a
policy that of [Learn a policy](../how-to/learn-a-policy.md); run the command in the folder of `module.py`.

The run folder holds `score.md`, `score.tex`, `score.csv` (every print) and `score.png`.

| plant | the printer | the sensor |
|---|---|---|
| `plant-v1/lu` | layer-to-layer model, up to 20 % of a droplet missing (Lu, Zheng, Mishra 2015) | exact |
| `plant-v1/lu-laser` | the same, up to 40 % | laser line, 1 µm |
| `plant-v1/lu-wide` | droplets that spread over two cells | exact |
| `plant-v1/caps` | spherical caps, no flow | exact |
| `plant-v1/volume-area` | volume and area propagation (Wu, Chiu 2024), guarded | exact |
| `plant-v1/young-laplace-linear` | lines under surface tension (Hume, Rosen 2018), linear | exact |
| `plant-v1/young-laplace` | the same, nonlinear | exact |
| `plant-v2/lu-shift` | that of `lu` | shifted by 0.3 cells along x, 0.2 along y, 0.1 more or less from scan to scan |
| `plant-v2/lu-spot` | that of `lu` | spot with a standard deviation of one cell |
| `plant-v2/lu-dropout` | that of `lu` | loses one reading in ten, and all on walls |
| `plant-v2/lu-scans` | that of `lu` | shift 0.25 cells, spot 0.5 cells, noise 1 µm, steps 0.1 µm, 10 % lost |
| `plant-v2/caps-scans` | that of `caps` | the same |
| `plant-v2/young-laplace-shift` | that of `young-laplace` | shifted by 0.25 cells along x |

"Lu nominal" knows the volume of a droplet, in the proportions of Lu et al., Table I. "Identified" is fitted to eight
random layers printed on the plant. "Single droplet" is what one droplet leaves on flat ground; "superposition" (greedy
geometric feedback, Cohen and Lipson 2010) adds it up. "Learning" also fits the three heights during the print
(`adapt_ink = "full"`).
"""


def write_papers(runs: Path) -> None:
    """The figures of each paper as CSV, and the pictures of the page."""
    for paper, pictures in PAPERS.items():
        if main(["reproduce", paper, "--out", str(runs / paper)]) != 0:
            raise SystemExit(f"inkloop reproduce {paper} did not end well")
        write_text(record_of(paper), spreadsheet((runs / paper / "table.md").read_text(encoding="utf-8")))
        for picture in pictures:
            shutil.copy(runs / paper / f"{picture}.png", HERE / f"{picture}.png")


def record_of(paper: str) -> Path:
    """The file with all figures of a paper."""
    return RECORDS / f"{paper}.csv"


def spreadsheet(page: str) -> str:
    """The rows of the table of a page, rounded as they are there, as CSV."""
    lines = [line for line in page.splitlines() if line.startswith("| ")]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(line.strip("| ").split(" | ") for line in lines)
    return text.getvalue()


def rows_of(paper: str) -> list[list[str]]:
    """All figures of a paper, in the columns of `HEADINGS`."""
    with record_of(paper).open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))[1:]


def write_score(runs: Path) -> None:
    """score-board.md and its picture."""
    if main(["score", "--out", str(runs / "score")]) != 0:
        raise SystemExit("inkloop score did not end well")
    shutil.copy(runs / "score" / "score.png", HERE / "score.png")
    page = without_inks((runs / "score" / "score.md").read_text(encoding="utf-8"))
    write_text(HERE / "score-board.md", f"{SCORE_PAGE}\n{page}\n![rms by controller and plant](score.png)\n")


def without_inks(page: str) -> str:
    """The tables of a score without those of the inks that controllers assume."""
    return INKS.sub("", page).rstrip() + "\n"


def run() -> None:
    """Both pages."""
    shutil.rmtree(BUILD, ignore_errors=True)
    write_papers(BUILD)
    write_score(BUILD)


def texts() -> Texts:
    """The figures that each paper prints; `run` writes the score board as a whole."""
    return {HERE / "the-papers.md": {paper: "\n" + printed_figures(paper) + "\n" for paper in PAPERS}}


def printed_figures(paper: str) -> str:
    """Count of the reproduced figures of a paper, and a table of the others."""
    verdict = HEADINGS.index("reproduced")
    rows = [row for row in rows_of(paper) if row[verdict] != "-"]
    others = [row for row in rows if row[verdict] != "yes"]
    above = ["", *(row[0] for row in others)]
    shown = [["" if row[0] == upper else row[0], *row[1:]] for row, upper in zip(others, above, strict=False)]
    count = f"Reproduced: {len(rows) - len(others)} of {len(rows)} printed figures that can be compared. The others:\n"
    return "\n" + count + table(HEADINGS, shown)
