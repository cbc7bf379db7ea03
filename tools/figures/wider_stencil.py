"""What a stencil of 5 x 5 cells predicts and controls better than that of Lu et al., for identify-an-ink.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from tools.figures.pages import DOCS, Texts, read_json, table, write_json

from inkloop.component import Ink
from inkloop.units import M_PER_UM, UM_PER_M
from inkloop_lab.identify.candidates import candidates, conserving
from inkloop_lab.identify.cross_validation import Comparison, compare
from inkloop_lab.models import LayerDeposition
from inkloop_lab.score.board import OURS, SEEDS, Entry, load, prints
from inkloop_lab.score.known_inks import identified, layers_of

PAGE = DOCS / "how-to" / "identify-an-ink.md"
RECORD = DOCS / "how-to" / "wider-stencil.json"
PLANTS = ("lu-wide", "volume-area", "young-laplace-linear", "young-laplace")
"""Of the score board. The first one has a stencil of 5 x 5 cells."""
REACH = 2
NOMINAL, FITTED, WIDE = "Lu, nominal ink", "Lu, regression", conserving(REACH)
SEARCH = "inkloop_lab.score.stencil_search:StencilSearch"


def stencils(plant: str) -> Mapping[str, Comparison]:
    """Each stencil on layers of a plant, fitted to all of them, judged on cells that its fit had not seen."""
    scenario = load(plant)
    chosen = [one for one in candidates(scenario.job().inks, 0.0, reach=REACH) if one.name in (NOMINAL, FITTED, WIDE)]
    return {each.name: each for each in compare(chosen, [layers_of(scenario)], 0.0)}


def entries(heights_um: Sequence[float]) -> Iterator[Entry]:
    """LayerMpc, which knows three heights, and the search, which takes any number; heights_um: of the wide stencil."""
    near = Ink(*(height * M_PER_UM for height in heights_um[:3]))
    yield OURS
    if not any(heights_um[3:]):
        yield replace(OURS, name="LayerMpc, reach 2", ink=lambda _: near)
    yield replace(OURS, name="LayerMpc one layer ahead, Lu nominal", options={"horizon": 1})
    yield Entry("search one layer ahead, Lu nominal", SEARCH)
    yield Entry("search one layer ahead, Lu identified", SEARCH, ink=identified)
    yield Entry("search one layer ahead, reach 2", SEARCH, {"heights_um": list(heights_um)})


def run() -> None:
    """Fit the stencils and print with them."""
    record = {}
    for plant in PLANTS:
        found = stencils(plant)
        wide = found[WIDE].model
        assert isinstance(wide, LayerDeposition)
        heights_um = [height * UM_PER_M for height in wide.heights[0]]
        record[plant] = {
            "heights_um": heights_um,
            "one_step_um": {name: each.score.rms * UM_PER_M for name, each in found.items() if each.score},
            "rms_um": {entry.name: prints(entry, plant, SEEDS).mean("rms") for entry in entries(heights_um)},
        }
    write_json(RECORD, record)


def texts() -> Texts:
    """The table."""
    record = read_json(RECORD)
    rows = [("h4, h5, h6 of reach 2", *(_far(each["heights_um"]) for each in record.values()))]
    for part, label in (("one_step_um", "one step"), ("rms_um", "closed loop")):
        names = max((each[part] for each in record.values()), key=len)
        rows += [(f"{label}: {name}", *(_figure(each[part], name) for each in record.values())) for name in names]
    return {PAGE: {"wider stencil": table(("[µm]", *record), rows)}}


def _far(heights_um: Sequence[float]) -> str:
    return ", ".join(f"{height:.2f}" for height in heights_um[3:])


def _figure(figures: Mapping[str, float], name: str) -> str:
    """A dash where there is none: LayerMpc has no far heights."""
    return f"{figures[name]:.2f}" if name in figures else "-"
