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
    "gallery",
    "closed_loop",
    "lying_scans",
    "the_papers",
)
"""Modules of this folder."""
ALONE = ("performance",)
"""Run only when named: `make benchmarks` wants the machine for itself."""


def writer(name: str) -> Writer:
    """The module of a writer."""
    return cast(Writer, import_module(f"tools.figures.{name}"))
