"""`inkloop export layers`: bitmaps by pass, ink and drop size in a folder, with a manifest that describes them."""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap
from inkloop.contract import pass_colour
from inkloop.errors import ResultError, ScenarioError
from inkloop.exchange.layers import bitmap
from inkloop.exchange.layers.patterns import Patterns
from inkloop.files import new_folder, write_text
from inkloop.report.terminal import Terminal
from inkloop.tables import part_layers as layer_manifest
from inkloop.units import PL_PER_M3, UM_PER_M

SUFFIXES: Mapping[str, str] = {"tiff": ".tif", "png": ".png", "bmp": ".bmp"}
_LIBRARIES = ("inkloop", "numpy", "pillow")
INKS = "AB"
"""Letters of the materials 1 and 2 of a pattern."""


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
        files = write(
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


def write(
    patterns: Patterns,
    out: Path,
    *,
    form: str,
    layers: Sequence[int],
    passes: bool = False,
    split: str | None = None,
    on_layer: Callable[[int], None] = lambda layer: None,
) -> list[dict[str, Any]]:
    """Write the folder whole or not at all; returns the manifest's entries of the files.

    form: one of BITMAP_FORMATS; layers: numbers from 1; passes: separate them; split: one of DROP_SPLITS, None for
    planes where there are drops of several sizes; on_layer: called for each written layer. Raises OSError, also if
    `out` exists.
    """
    split = split or ("planes" if patterns.levels > 1 else None)
    files: list[dict[str, Any]] = []
    with new_folder(out) as folder:
        for layer in layers:
            for one in _separations(patterns, layer, passes, split):
                name = one.name(layer) + SUFFIXES[form]
                content = bitmap.encode(one.sites, patterns.pitch, form, f"layer {layer}, {one.title}")
                (folder / name).write_bytes(content)
                files.append(_entry(name, layer, one, content))
            on_layer(layer)
        manifest = _manifest(patterns, form, split, passes, files)
        write_text(folder / layer_manifest.NAME, json.dumps(manifest, indent=1) + "\n")
    return files


@dataclass(frozen=True, eq=False)
class Separation:
    """Sites (nx, ny) that one bitmap of a layer jets. number: of the pass in the order of jetting, from 1.

    colour: of the cells of the pass, see `contract.pass_colour`, None for all cells; drop: "", "d2" for the sites with
    drops of that size, "b1" for that bit of the level; drops: number of drops of a set pixel.
    """

    number: int
    colour: int | None
    ink: str
    drop: str
    drops: int
    sites: BoolMap

    @property
    def title(self) -> str:
        """Title of the bitmap, for a person."""
        return ", ".join(filter(None, (f"pass {self.number}", f"ink {self.ink}", self.drop)))

    def name(self, layer: int) -> str:
        """File name without suffix."""
        return "_".join(filter(None, (f"L{layer:04d}", f"P{self.number}", self.ink, self.drop)))


def _separations(patterns: Patterns, layer: int, passes: bool, split: str | None) -> Iterator[Separation]:
    """Bitmaps of a layer, empty ones included: every layer has the same set."""
    pattern = patterns.pattern[layer - 1]
    drops = np.ones_like(pattern) if patterns.drop_level is None else patterns.drop_level[layer - 1]
    i, j = np.indices(pattern.shape)
    for number, colour in enumerate((passes and patterns.colours(layer)) or (None,), start=1):
        of_pass = np.ones(pattern.shape, np.bool_) if colour is None else pass_colour(i, j) == colour
        for ink in range(1, len(patterns.inks) + 1):
            sites = (pattern == ink) & of_pass
            for name, worth, chosen in _by_drop(drops, patterns.levels, split):
                yield Separation(number, colour, INKS[ink - 1], name, worth, sites & chosen)


def _by_drop(
    drops: NDArray[np.integer], levels: int, split: str | None
) -> Iterator[tuple[str, int, NDArray[np.bool_]]]:
    if split == "bits":
        for bit in range(levels.bit_length()):
            yield f"b{bit}", 1 << bit, (drops >> bit) & 1 == 1
    elif split == "planes":
        for level in range(1, levels + 1):
            yield f"d{level}", level, drops == level
    else:
        yield "", 1, np.ones(drops.shape, np.bool_)


def _entry(name: str, layer: int, one: Separation, content: bytes) -> dict[str, Any]:
    pixels = int(one.sites.sum())
    return {
        "file": name,
        "layer": layer,
        "pass": one.number,
        "colour": one.colour,
        "ink": one.ink,
        "drops_per_pixel": one.drops,
        "pixels": pixels,
        "drops": pixels * one.drops,
        "sha256": hashlib.sha256(content).hexdigest(),
    }


def _manifest(
    patterns: Patterns, form: str, split: str | None, passes: bool, files: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    nx, ny = patterns.pattern.shape[1:]
    pitch_um = float(bitmap.pitch_text(patterns.pitch))
    stored_um = float(bitmap.pitch_text(bitmap.stored_pitch(patterns.pitch, form)))
    return {
        "format": layer_manifest.FORMAT,
        "format_version": layer_manifest.FORMAT_VERSION,
        "origin_of_patterns": patterns.origin,
        "image_format": form,
        "width_pixels": nx,
        "height_pixels": ny,
        "pitch_x_um": pitch_um,
        "pitch_y_um": pitch_um,
        "pitch_of_resolution_um": stored_um,
        "origin": layer_manifest.ORIGIN,
        "first_row": layer_manifest.FIRST_ROW,
        "first_column": layer_manifest.FIRST_COLUMN,
        "polarity": layer_manifest.POLARITY,
        "passes": patterns.process.passes if passes else 1,
        "pass_numbers": "in the order of jetting; colour = 2 (column mod 2) + row mod 2, null for all pixels",
        "drop_levels": patterns.levels,
        "drop_split": split,
        "inks": {
            INKS[number]: {
                "drop_volume_pl": ink.layer_height * patterns.pitch**2 * PL_PER_M3,
                "layer_height_um": ink.layer_height * UM_PER_M,
            }
            for number, ink in enumerate(patterns.inks)
        },
        "first_layer": files[0]["layer"],
        "last_layer": files[-1]["layer"],
        "unknown_layers": sorted({one["layer"] for one in files} & set(patterns.unknown_layers)),
        "scenario_sha256": hashlib.sha256(patterns.scenario_text.encode()).hexdigest(),
        "versions": {"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}},
        "files": list(files),
    }


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
