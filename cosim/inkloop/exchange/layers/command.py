"""`inkloop export layers`: the layers of a run, or of a planned open loop, as bitmaps."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from inkloop.errors import ResultError, ScenarioError
from inkloop.exchange.layers import archive
from inkloop.exchange.layers.patterns import Patterns
from inkloop.report.terminal import Terminal
from inkloop.tables import part_layers as layer_manifest


def export(patterns: Patterns, source: Path, options: argparse.Namespace, console: Terminal) -> int:
    """Write the folder and describe it; returns the exit code. Raises ResultError, OSError."""
    if errors := _errors(patterns, options):
        raise ScenarioError(str(source), errors)
    layers = _layers(source, options.layers, len(patterns.pattern))
    out = options.out or Path(f"{source.resolve().stem}-layers")
    if out.exists():
        raise ResultError(f"{out}: is there already; name another folder with --out, or remove it")
    with console.progress() as progress:
        task = progress.add_task("layers", total=len(layers))
        files = archive.write(
            patterns,
            out,
            form=options.format,
            layers=layers,
            passes=options.passes,
            split=options.drop_levels,
            on_layer=lambda layer: progress.update(task, advance=1),
        )
    drops = sum(entry["drops"] for entry in files)
    console.sentence(
        f"wrote {out}: layers {layers[0]} to {layers[-1]}, bitmaps: {len(files)}, drops: {drops}; {patterns.origin}"
    )
    console.sentence(f"  the first row is y = 0, a set bit (black) is a droplet; {layer_manifest.NAME} has the rest")
    if unknown := [layer for layer in layers if layer in patterns.unknown_layers]:
        shown = ", ".join(map(str, unknown))
        console.sentence(f"  layers that were aborted, what of them was jetted is unknown: {shown}")
    console.result(folder=out, layers=[layers[0], layers[-1]], drops=drops, files=[entry["file"] for entry in files])
    return 0


def _errors(patterns: Patterns, options: argparse.Namespace) -> list[str]:
    if options.passes and patterns.process.passes == 1:
        return ["--passes: a layer is one pass here; leave --passes out, or set process.passes = 4 in the scenario"]
    if not len(patterns.pattern):
        return ["no layer of the part needs a droplet: its height is less than half of a layer"]
    return []


def _layers(source: Path, asked: str | None, count: int) -> range:
    """The layers of "3-7" or "3". Raises ResultError where they are none of 1 .. count."""
    if asked is None:
        return range(1, count + 1)
    match = re.fullmatch(r"(\d+)(?:-(\d+))?", asked)
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
    if not 1 <= first <= last <= count:
        raise ResultError(f"{source}: --layers {asked}: expected A-B within layers 1 to {count}, for example 1-{count}")
    return range(first, last + 1)
