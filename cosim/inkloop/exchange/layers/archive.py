"""Write the bitmaps of layers into a folder, with a manifest that describes them."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from inkloop.exchange.layers import bitmap
from inkloop.exchange.layers.patterns import Patterns
from inkloop.exchange.layers.separations import INKS, Separation, separations
from inkloop.files import new_folder, write_text
from inkloop.tables import part_layers as layer_manifest
from inkloop.units import PL_PER_M3, UM_PER_M

SUFFIXES: Mapping[str, str] = {"tiff": ".tif", "png": ".png", "bmp": ".bmp"}
_LIBRARIES = ("inkloop", "numpy", "pillow")


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
            for one in _separated(patterns, layer, passes, split):
                name = one.name(layer) + SUFFIXES[form]
                content = bitmap.encode(one.sites, patterns.pitch, form, f"layer {layer}, {one.title}")
                (folder / name).write_bytes(content)
                files.append(_entry(name, layer, one, content))
            on_layer(layer)
        manifest = _manifest(patterns, form, split, passes, files)
        write_text(folder / layer_manifest.NAME, json.dumps(manifest, indent=1) + "\n")
    return files


def _separated(patterns: Patterns, layer: int, passes: bool, split: str | None) -> list[Separation]:
    level = None if patterns.drop_level is None else patterns.drop_level[layer - 1]
    return list(
        separations(
            patterns.pattern[layer - 1],
            level,
            inks=len(patterns.inks),
            levels=patterns.levels,
            split=split,
            colours=patterns.colours(layer) if passes else (),
        )
    )


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
