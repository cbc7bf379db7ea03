"""Short tables for notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape


def html_table(caption: str, rows: Mapping[str, str]) -> str:
    """A table of names and values under a caption; the texts are escaped."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    head = f"<caption style='text-align:left'><b>{escape(caption)}</b></caption>"
    return f"<table>{head}<tbody>{cells}</tbody></table>"
