"""Draw the house from the imports of the code, for architecture.md.

A room is a folder or file at the root of a package; it stands above every room that it imports. On top the flow of a
layer.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from tools.figures.pages import DOCS, Texts

from support.source_tree import PACKAGES, circles, grouped, import_graph, modules, room

FOLDER = DOCS / "explanation"
FLOOR = ("component", "contract", "errors", "files", "geometry", "testing", "units")
COLUMNS: Mapping[str, tuple[float, float]] = {
    "inkloop_controller": (0.0, 27.0),
    "inkloop": (30.0, 40.0),
    "inkloop_hardware": (73.0, 27.0),
    "inkloop_lab": (30.0, 40.0),
}
"""Package -> left edge and width of its column."""
BELOW = {"inkloop_lab": "inkloop"}
"""Package -> the one whose column it stands on."""
TITLES = {
    "inkloop_controller": "controller/inkloop_controller",
    "inkloop": "cosim/inkloop",
    "inkloop_hardware": "hardware/inkloop_hardware",
    "inkloop_lab": "lab/inkloop_lab",
}
NATIVE = (
    ("controller/core", 0.0, 27.0, "the search core, C"),
    ("fmus/  (models/InkLoop states the same equations)", 30.0, 40.0, "plant, sensor, controller as FMUs, C"),
    ("hardware/firmware", 73.0, 27.0, "nodes and emulator, C"),
)
STEPS = (
    ("estimate the surface", "inkloop_controller.estimation"),
    ("plan the next layer", "inkloop_controller.planning"),
    ("print and cure it", "LayerDeposition.fmu, or\nhead, stage and lamp on CAN"),
    ("scan the surface", "ProfileSensor.fmu, or\na profiler on CAN"),
)
"""Step of the loop, and the part that does it."""
SIGNALS = (
    ("pattern\nlayer_command", 2),
    ("height\nlayers_printed", 3),
)
"""Signals of the layer contract, and the step that takes them."""
BACK = "measured_height, valid, layers_scanned; inkloop.master carries every signal"
RULE = "a room imports only rooms below it in its own column, and the floor; scenarios and entry points name the rest"
HEIGHT, GAP, TITLE = 3.0, 1.4, 3.0
BLUE, INK, PAPER, FLOOR_COLOUR, FLOW_COLOUR = "#0072B2", "#333333", "#F2F2F2", "#E3EDF5", "#FFFFFF"


@cache
def rooms() -> dict[str, set[str]]:
    """Room -> rooms that it imports; the floor is left out."""
    graph = grouped(import_graph(), {name: room(name) for name in modules()})
    hidden = {*PACKAGES, *(f"inkloop.{name}" for name in FLOOR)}
    return {name: below - hidden for name, below in graph.items() if name not in hidden}


def storeys() -> dict[str, int]:
    """Room -> its storey: one above the highest room that it imports. Raises ValueError where there is none."""
    if found_circles := circles(rooms()):
        found = "; ".join(sorted(" and ".join(sorted(circle)) for circle in found_circles))
        raise ValueError(f"rooms import each other in a circle: {found}; move what they share to a room below")
    known: dict[str, int] = {}

    def storey(name: str) -> int:
        if name not in known:
            known[name] = 1 + max((storey(below) for below in rooms()[name]), default=-1)
        return known[name]

    for name in rooms():
        storey(name)
    return known


def rows(package: str) -> list[list[str]]:
    """The rooms of a package, storey by storey; storeys of other packages alone are left out."""
    own = {name: level for name, level in storeys().items() if name.startswith(f"{package}.")}
    return [sorted(name for name in own if own[name] == level) for level in sorted(set(own.values()))]


def ground(package: str) -> float:
    """Bottom edge of the column of a package."""
    return roof(BELOW[package]) + TITLE if package in BELOW else 14.0


def roof(package: str) -> float:
    """Top edge of the column of a package."""
    return ground(package) + len(rows(package)) * (HEIGHT + GAP)


def places() -> dict[str, tuple[float, float, float]]:
    """Room -> left edge, bottom edge, width."""
    found = {}
    for package, (left, width) in COLUMNS.items():
        for level, row in enumerate(rows(package)):
            step = width / len(row)
            for number, name in enumerate(row):
                found[name] = (left + number * step + 0.3, ground(package) + level * (HEIGHT + GAP), step - 0.6)
    return found


def box(axes: Axes, left: float, bottom: float, width: float, text: str, colour: str, height: float = HEIGHT) -> None:
    """A rounded box with a text in it."""
    style = "round,pad=0,rounding_size=0.5"
    axes.add_patch(FancyBboxPatch((left, bottom), width, height, boxstyle=style, fc=colour, ec=INK, lw=0.7, zorder=2))
    axes.text(left + width / 2, bottom + height / 2, text, ha="center", va="center", fontsize=7.5, color=INK, zorder=4)


def flow(axes: Axes, bottom: float) -> None:
    """The way of a layer round the loop; every arrow passes through the master."""
    width, step = 18.0, 27.3
    for number, (title, where) in enumerate(STEPS):
        left = number * step
        box(axes, left, bottom, width, f"{title}\n{where}", FLOW_COLOUR, 5.0)
        if number:
            arrow(axes, (left - step + width, bottom + 2.5), (left, bottom + 2.5))
    last = (len(STEPS) - 1) * step + width / 2
    axes.plot([last, last, width / 2], [bottom, bottom - 1.6, bottom - 1.6], color=BLUE, lw=1.6, zorder=1)
    arrow(axes, (width / 2, bottom - 1.6), (width / 2, bottom))
    for signals, number in SIGNALS:
        axes.text(number * step - (step - width) / 2, bottom + 4.0, signals, fontsize=7, color=BLUE, ha="center")
    frame = {"fc": "white", "ec": "none", "pad": 2}
    axes.text(50, bottom - 1.6, BACK, fontsize=7, color=BLUE, ha="center", va="center", bbox=frame)


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """A blue arrow."""
    style = {"arrowstyle": "-|>", "color": BLUE, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=style, zorder=3)


def draw() -> Figure:
    """The picture."""
    top = max(map(roof, COLUMNS))
    figure = Figure(figsize=(10.0, 0.1 * (top + 19)), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(-1.0, 101.0), ylim=(-0.5, top + 16.5), aspect="equal")
    axes.axis("off")
    axes.text(50, top + 15.5, "The flow of a layer", ha="center", fontsize=9, weight="bold", color=INK)
    flow(axes, top + 8.5)
    for package, (left, width) in COLUMNS.items():
        title = TITLES[package]
        axes.text(left + width / 2, roof(package) + 0.4, title, ha="center", fontsize=9, weight="bold", color=INK)
    for name, (left, bottom, width) in places().items():
        box(axes, left, bottom, width, name.rpartition(".")[2], PAPER)
    axes.text(50, 12.3, RULE, ha="center", va="center", fontsize=7.5, color=INK, style="italic")
    box(axes, 0.3, 7.6, 99.4, f"the floor, in cosim/inkloop:  {'   '.join(FLOOR)}", FLOOR_COLOUR)
    for title, left, width, what in NATIVE:
        box(axes, left + 0.3, 0.8, width - 0.6, f"{title}\n{what}", PAPER, 4.2)
    return figure


def texts() -> Texts:
    """None: the page shows a picture alone."""
    return {}


def run() -> None:
    """Draw the picture."""
    draw().savefig(FOLDER / "house.png", dpi=160)
