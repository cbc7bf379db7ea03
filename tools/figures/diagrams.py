"""Draw each FMU as a block with its inputs and outputs, from variables.toml: fmus/<model>/diagram.png.

An FMU holds the picture as documentation/diagram.png, where FMI 3 looks for it. The text of the picture is kept in it
as its description, by which a test knows whether it is the present one.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from tools.figures.pages import ROOT, Texts

from inkloop.fmu_writer import definition
from inkloop.fmu_writer.definition import ModelDefinition

DEFINITIONS = sorted((ROOT / "fmus").glob("*/variables.toml"))
BLUE, INK, PAPER = "#0072B2", "#333333", "#F2F2F2"
LINE, CHARACTER, COLOURS = 0.17, 0.068, 8


def rows(model: ModelDefinition, causality: str) -> Iterator[tuple[str, str, bool]]:
    """Name, unit and kind of each port, and whether it is a map; before those of a terminal its name and a colon."""
    ports = [v for v in model.exposed if v.causality == causality]
    for terminal in (*model.buses, *model.terminals, None):
        members = [v for v in ports if v.terminal == terminal]
        if members:
            yield f"{terminal or 'others'}:", "", False
        for v in members:
            kind = "" if v.type == "real" else v.declared or v.type
            yield v.name, " ".join(filter(None, (f"[{v.unit}]" if v.unit != "1" else "", kind))), v.is_grid


def text(model: ModelDefinition) -> str:
    """All that the picture says."""
    sides = ("\n".join(map(str, rows(model, causality))) for causality in ("input", "output"))
    return "\n\n".join((model.name, *sides))


def draw(model: ModelDefinition) -> Figure:
    """Inputs on the left, outputs on the right; a thick arrow carries a map."""
    sides = [list(rows(model, causality)) for causality in ("input", "output")]
    widths = [CHARACTER * max(len(name) + len(kind) + 2 for name, kind, _ in side) for side in sides]
    width, height = sum(widths) + 0.6, LINE * (max(map(len, sides)) + 2)
    figure = Figure(figsize=(width + 0.8, height + 0.1))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-0.4, width + 0.4), ylim=(-0.05, height + 0.05))
    axes.axis("off")
    axes.fill([0, width, width, 0], [0, 0, height, height], fc=PAPER, ec=INK, lw=0.8)
    axes.text(width / 2, height - LINE, model.name, ha="center", va="center", fontsize=9, weight="bold", color=INK)
    for side, edge, inward, align in ((sides[0], 0.0, 1, "left"), (sides[1], width, -1, "right")):
        for number, (name, kind, is_map) in enumerate(side):
            y = height - LINE * (number + 2.3)
            if name.endswith(":"):
                axes.text(edge + 0.08 * inward, y, name, ha=align, va="center", fontsize=7, style="italic", color=BLUE)
                continue
            begin, end = (edge - 0.3, edge) if inward > 0 else (edge, edge + 0.3)
            style = {"arrowstyle": "-|>", "color": BLUE, "lw": 2.2 if is_map else 0.8, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", (end, y), (begin, y), arrowprops=style)
            words = (name, kind) if inward > 0 else (kind, name)
            axes.text(edge + 0.08 * inward, y, "  ".join(words).strip(), ha=align, va="center", fontsize=7, color=INK)
    return figure


def write(path: Path, model: ModelDefinition) -> None:
    """The picture in a few colours, with its text."""
    content, about = io.BytesIO(), PngInfo()
    draw(model).savefig(content, dpi=110)
    about.add_text("Description", text(model))
    Image.open(content).convert("RGB").quantize(COLOURS).save(path, optimize=True, pnginfo=about)


def texts() -> Texts:
    """None: an FMU shows a picture alone."""
    return {}


def run() -> None:
    """Draw the pictures."""
    for path in DEFINITIONS:
        write(path.with_name("diagram.png"), definition.load(definition.text_of(path), path))
