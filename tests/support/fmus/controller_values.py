"""The header with the struct of LayerController's variables, which the controller core includes."""

from __future__ import annotations

from pathlib import Path

from inkloop.fmu_writer import c_tables, definition
from support.once_per_run import once
from support.places import ROOT

DEFINITION = ROOT / "fmus" / "layer_controller" / "variables.toml"


def controller_values() -> Path:
    """The folder of layer_controller_values.h."""
    return once(_write)


def _write(folder: Path) -> None:
    model = definition.load(DEFINITION.read_text(encoding="utf-8"), DEFINITION)
    (folder / "layer_controller_values.h").write_text(c_tables.values_header(model), encoding="utf-8")
