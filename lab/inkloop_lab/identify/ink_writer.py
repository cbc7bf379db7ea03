"""Write an identified ink as a file that scenarios name (see `inkloop.tables.ink_file`)."""

from __future__ import annotations

import math
from datetime import date
from pathlib import Path
from typing import Any

import tomlkit

from inkloop import __version__
from inkloop.files import write_text
from inkloop.tables.ink_file import InkFile
from inkloop.units import PL_PER_M3, UM_PER_M
from inkloop_lab.identify.identification import Identification
from inkloop_lab.identify.print_record import IdentificationError
from inkloop_lab.identify.volume_area_coefficients import NAMES
from inkloop_lab.models import SuperpositionDeposition, VolumeAreaDeposition, YoungLaplaceDeposition

DIGITS = 5


def write_ink(found: Identification, path: Path, today: date) -> None:
    """Writes the ink; nothing is overwritten. Raises IdentificationError."""
    if path.exists():
        raise IdentificationError(f"{path}: is there already and is not overwritten; name another --out")
    document = tomlkit.document()
    sources = ", ".join(record.name for record in found.records)
    for line in (
        f"Ink identified by inkloop {__version__} on {today.isoformat()} from {sources}.",
        f'In a scenario next to this file:  [ink]  file = "{path.name}"',
        *(f"Corrected: {place}." for place in found.displaced),
    ):
        document.add(tomlkit.comment(line))
    heights, widths = found.ink.heights, found.ink.half_widths
    for material, values, half in zip("ab", heights, widths, strict=False):
        table = tomlkit.table()
        for k, (value, width) in enumerate(zip(values, half, strict=True), start=1):
            item = tomlkit.item(_rounded(max(0.0, value) * UM_PER_M))
            item.comment(f"+- {width * UM_PER_M:.2g} (95 %)")
            table.add(f"h{k}_um", item)
        document[material] = table
    models = tomlkit.table(is_super_table=True)
    for kind, options in _models(found).items():
        models[kind] = options
    document["models"] = models
    document["identified"] = _identified(found)
    text = tomlkit.dumps(document)
    InkFile.model_validate(tomlkit.parse(text).unwrap())
    try:
        write_text(path, text)
    except OSError as error:
        raise IdentificationError(f"{path}: cannot be written: {error.strerror}") from error


def _models(found: Identification) -> dict[str, dict[str, Any]]:
    """Options of the other deposition models, as keys of a component of that kind."""
    tables: dict[str, dict[str, Any]] = {}
    if found.plant is not None:
        heights = {
            f"h{k}_{m}_um": height * UM_PER_M
            for m, ink in zip("ab", found.plant.heights, strict=False)
            for k, height in enumerate(ink, start=1)
        }
        tables["LayerDeposition"] = heights
    scored = [one for one in found.comparisons if one.score]
    for comparison in sorted(scored, key=lambda one: one.score.rms if one.score else math.inf):
        model = comparison.model
        if isinstance(model, SuperpositionDeposition):
            radius, height = model.caps[0]
            named = {f"cap_radius_{m}_um": radius for m in "ab"} | {f"cap_height_{m}_um": height for m in "ab"}
            tables["SuperpositionDeposition"] = {key: value * UM_PER_M for key, value in named.items()}
        elif isinstance(model, YoungLaplaceDeposition):
            liquid = {"droplet_volume_pl": model.droplet_volume * PL_PER_M3}
            tables["YoungLaplaceDeposition"] = liquid | {"contact_angle_deg": math.degrees(model.contact_angle)}
        elif (
            isinstance(model, VolumeAreaDeposition) and "VolumeAreaDeposition" not in tables
        ):  # the better one of the two
            gains = {f"{name}_per_um": getattr(model, name) / UM_PER_M for name in NAMES}
            tables["VolumeAreaDeposition"] = {"height_scale_um": model.height_scale * UM_PER_M, **gains} | (
                {"cap_radius_um": model.cap_radius * UM_PER_M} if model.cap_radius else {}
            )
    rounded = {kind: {key: _rounded(value) for key, value in table.items()} for kind, table in tables.items()}
    if "LayerDeposition" in rounded:
        rounded["LayerDeposition"] = {"reach": found.reach, **rounded["LayerDeposition"]}
    if "VolumeAreaDeposition" in rounded:
        rounded["VolumeAreaDeposition"] |= {"guard": True, "limit_gains": True}
    return rounded


def _identified(found: Identification) -> dict[str, Any]:
    """Origin and accuracy of the numbers."""
    scores = {c.name: _rounded(c.score.rms * UM_PER_M) for c in found.comparisons if c.score}
    return {
        "method": "regression over layers, corrected for the noise of the scans",
        "prints": [record.name for record in found.records],
        "pitch_um": found.records[0].pitch * UM_PER_M,
        "noise_um": _rounded(found.noise_std * UM_PER_M),
        "droplet_std": _rounded(found.ink.droplet_std),
        "growths": found.ink.used,
        "one_step_rms_um": scores,
    }


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
