"""State of each node by a log of devices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

LOG_LINES = 40
"""Number of last lines shown on a page."""


def devices(log: Path) -> dict[str, Any] | None:
    """The last message of each node in a log of devices, and the last lines; None without a log."""
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except FileNotFoundError:
        return None
    nodes: dict[str, list[str]] = {}
    for line in lines:
        day, _, rest = line.partition(" ")
        time, _, rest = rest.partition(" ")
        level, _, message = rest.partition(" ")
        node, separator, words = message.partition(": ")
        if separator and " " not in node:
            nodes[node] = [node, f"{day} {time}", "" if level == "INFO" else level.lower(), words]
    return {"nodes": list(nodes.values()), "log": lines[-LOG_LINES:]}
