"""Which dependencies have no wheel on a platform of a release, by the files that its package index lists to pip."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import canonicalize_name, parse_wheel_filename
from packaging.version import Version
from tools.release.requirements import closure

from inkloop.fmu_writer.targets import TARGETS, Target
from support.places import ROOT

PYTHONS = ("3.11", "3.12", "3.13")
GLIBC_NEWEST, MACOS_NEWEST = 40, 15
"""Newest systems that are asked for: glibc 2.40, macOS 15."""
LEGACY = {"manylinux1": (2, 5), "manylinux2010": (2, 12), "manylinux2014": (2, 17)}
"""Older names of tags, and the glibc that they stand for."""
SYSTEM_NAMES = {"Linux": "glibc", "Darwin": "macOS", "Windows": "Windows"}
OLDEST_WINDOWS = (10,)


def checked() -> dict[str, Any]:
    """Packages asked for, and platform -> Python -> packages without a wheel, and the oldest system that all run on."""
    wanted = pins(ROOT)
    files = listed(wanted)
    rows: dict[str, Any] = {}
    for target in TARGETS.values():
        own = needed(target, [parse_wheel_filename(f"inkloop-0-py3-none-{target.wheel}.whl")[3]], PYTHONS[0])
        for python in PYTHONS:
            needs = {name: needed(target, wheels, python) for name, wheels in files.items()}
            missing = sorted(name for name, need in needs.items() if need is None)
            newest = max(need for need in (own, *needs.values()) if need is not None)
            system = f"{SYSTEM_NAMES[target.system]} {'.'.join(map(str, newest))}"
            rows.setdefault(target.name, {})[python] = {"missing": missing, "system": system}
    return {"packages": wanted, "platforms": rows}


def pins(root: Path) -> list[str]:
    """What a print requires and is compiled, in the versions of this environment."""
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    found, _ = closure(project["dependencies"])
    return [f"{name}=={each.version}" for name, each in found.items() if is_compiled(name)]


def is_compiled(name: str) -> bool:
    """Whether the installed wheel of a package is for one platform."""
    text = distribution(name).read_text("WHEEL") or ""
    return not re.search(r"^Tag: .*-none-any$", text, re.MULTILINE)


def listed(wanted: Sequence[str]) -> dict[str, list[frozenset[Tag]]]:
    """Name -> tags of each wheel of these versions, for any platform, in what pip says of the pages that it reads.

    Raises RuntimeError where it reads none.
    """
    base = sys._base_executable  # type: ignore[attr-defined]  # the environment itself has no pip
    options = ["--dry-run", "--ignore-installed", "--no-deps", "--no-color", "-vvv"]
    done = subprocess.run(
        [base, "-m", "pip", "install", *options, *wanted], capture_output=True, text=True, check=False
    )
    versions = {
        canonicalize_name(name): Version(version) for name, _, version in (pin.partition("==") for pin in wanted)
    }
    found: dict[str, list[frozenset[Tag]]] = {}
    for file in sorted(set(re.findall(r"[\w.]+-[\w.]+-[\w.]+-[\w.]+-[\w.]+\.whl\b", done.stdout))):
        name, version, _, tags = parse_wheel_filename(file)
        if versions.get(name) == version:
            found.setdefault(name, []).append(tags)
    if lost := sorted(set(versions) - set(found)):
        raise RuntimeError(f"pip names no wheel of {', '.join(lost)}:\n{done.stderr[-2000:]}")
    return found


def needed(target: Target, wheels: Sequence[frozenset[Tag]], python: str) -> tuple[int, ...] | None:
    """The oldest system on which one of the wheels of a package runs; None: there is no wheel for that platform."""
    version = tuple(int(part) for part in python.split("."))
    systems = platforms(target)
    names = list(systems)
    interpreter = f"cp{version[0]}{version[1]}"
    accepted = {*cpython_tags(version, platforms=names), *compatible_tags(version, interpreter, names)}
    fitting = [tag for tags in wheels for tag in tags if tag in accepted]
    return min((systems.get(tag.platform, (0,)) for tag in fitting), default=None)


def platforms(target: Target) -> Mapping[str, tuple[int, ...]]:
    """Tags of wheels that run on the newest system of a platform, and the version of it that each asks for."""
    match target.system:
        case "Linux":
            processor = target.name.partition("-")[0]
            numbered = {f"manylinux_2_{minor}_{processor}": (2, minor) for minor in range(5, GLIBC_NEWEST + 1)}
            return numbered | {f"{name}_{processor}": version for name, version in LEGACY.items()}
        case "Darwin":
            processor = "arm64" if target.name.startswith("aarch64") else "x86_64"
            versions = [
                *((10, minor) for minor in range(4, 17)),
                *((major, 0) for major in range(11, MACOS_NEWEST + 1)),
            ]
            return {
                f"macosx_{major}_{minor}_{kind}": (major, minor)
                for major, minor in versions
                for kind in (processor, "universal2")
            }
        case _:
            return {target.wheel: OLDEST_WINDOWS}
