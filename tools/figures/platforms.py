"""What a release was seen to do on each platform, and which dependencies have no wheel there, for platforms.md.

`platforms/wheels` asks the package index, `platforms/runs` runs binaries.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from tools.figures.dependency_wheels import PYTHONS, checked
from tools.figures.pages import DOCS, Texts, read_json, table, write_json

from inkloop.fmu_writer.targets import TARGETS
from support.fmus.foreign_run import WINE, wine_in
from support.fmus.twenty_layers import TwentyLayers, runner

PAGE = DOCS / "reference/platforms.md"
RECORD = DOCS / "reference/platforms.json"
HOW = {"x86_64-linux": "here", "aarch64-linux": "in qemu-user", "x86_64-windows": "under Wine"}
"""Where a binary for a platform is run, on a machine with Linux on x86_64."""
SIGNED = "Whether macOS accepts the signature that the linker writes was not tried"


def run(*parts: str) -> None:
    """Ask the index (`wheels`), run the binaries (`runs`), or both; what is not done stays as it was."""
    record = read_json(RECORD) if RECORD.exists() else {}
    if not parts or "wheels" in parts:
        record["wheels"] = checked()
    if not parts or "runs" in parts:
        record["runs"] = hashes()
    write_json(RECORD, record)


def hashes() -> dict[str, str]:
    """Compiler and platform -> SHA-256 of twenty layers; platforms that nothing here runs are left out."""
    with tempfile.TemporaryDirectory() as name:
        twenty = TwentyLayers(Path(name))
        found = {"gcc x86_64-linux": twenty.by_gcc({})}
        for platform in (name for name, target in TARGETS.items() if runner(target) is not None):
            if platform == "x86_64-windows" and WINE:
                with wine_in(Path(name, "wine")) as environment:
                    found[f"zig {platform}"] = twenty.by_zig(platform, environment)
            else:
                found[f"zig {platform}"] = twenty.by_zig(platform, {})
    return found


def texts() -> Texts:
    """Both tables."""
    record = read_json(RECORD)
    return {PAGE: {"platform-runs": runs_table(record["runs"]), "dependency-wheels": wheels_table(record["wheels"])}}


def runs_table(found: dict[str, str]) -> str:
    """Binary, how it was run, and whether it gave the bits of the reference."""
    reference = found["gcc x86_64-linux"]
    rows = [("`x86_64-linux`", "gcc", "run here", f"the reference: `{reference[:16]}`")]
    for platform, target in TARGETS.items():
        digest = found.get(f"zig {platform}")
        if digest is not None:
            same = "the same bits" if digest == reference else f"others: `{digest[:16]}`"
            rows.append((f"`{platform}`", "zig", f"run {HOW[platform]}", same))
        else:
            rows.append((f"`{platform}`", "zig", "not run", SIGNED if target.system == "Darwin" else ""))
    return table(("binary", "by", "how", "20 layers of `LayerDeposition`"), rows)


def wheels_table(record: dict[str, Any]) -> str:
    """A line for each platform: packages without a wheel by version of Python, and the oldest system."""
    rows = []
    for platform, by_python in record["platforms"].items():
        missing = [", ".join(by_python[python]["missing"]) or "none" for python in PYTHONS]
        systems = [by_python[python]["system"] for python in PYTHONS]
        rows.append((f"`{platform}`", TARGETS[platform].wheel, *missing, max(systems, key=number_of)))
    return table(
        ("platform", "wheel", *(f"without a wheel, Python {python}" for python in PYTHONS), "oldest system"), rows
    )


def number_of(system: str) -> tuple[int, ...]:
    """The version in the name of a system."""
    return tuple(int(part) for part in system.rpartition(" ")[2].split("."))
