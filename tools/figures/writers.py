"""All writers of texts in pages, in the order of `make figures`."""

from __future__ import annotations

from importlib import import_module
from typing import cast

from tools.figures.pages import Writer

WRITERS = (
    "options",
    "api",
    "command_line",
    "can_protocol",
    "house",
    "bench_faults",
    "gallery",
    "own_part",
    "cylinder_prints",
    "closed_loop",
    "lying_scans",
    "layer_problem",
    "height_maps",
    "modelica_library",
    "identified_ink",
    "wider_stencil",
    "environment_times",
    "the_papers",
)
"""Modules of this folder."""
ALONE = ("peers", "house_times", "performance", "platforms")
"""Run only when named: `make peers` installs the masters of others that it needs; `make test` tests what others do;
`make benchmarks` wants the machine for itself; `platforms` asks the package index, and runs what `make tools` brings.
"""


def writer(name: str) -> Writer:
    """The module of a writer."""
    return cast(Writer, import_module(f"tools.figures.{name}"))
