"""Twenty layers of LayerDeposition, 30 x 30 cells, by its binary for a platform: here, in qemu-user or under Wine."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import fmpy
import pytest

from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import export_fmu, with_platforms
from inkloop.fmu_writer.targets import TARGETS, Target
from support.fmus.foreign_run import AARCH64_LIBRARIES, QEMU, WINE, answers, compiled, script_of

MODEL = "LayerDeposition"
LAYERS, SIDE = 20, 30
VALUES = {"layer_period": 1.0, "variation": 0.3, "seed": 7}
HAS_WINE = pytest.mark.skipif(WINE is None, reason="needs wine64 (make tools)")
HAS_QEMU = pytest.mark.skipif(
    QEMU is None or not AARCH64_LIBRARIES.is_dir(), reason="needs qemu-user and libc6-arm64-cross (make tools)"
)


def runner(target: Target) -> list[str] | None:
    """Command prefix that runs a program of a target on this machine; None: nothing here does."""
    if target.name == fmpy.platform_tuple:
        return []
    if target.name == "aarch64-linux" and QEMU and AARCH64_LIBRARIES.is_dir():
        return [QEMU, "-L", str(AARCH64_LIBRARIES)]
    return [WINE] if target.name == "x86_64-windows" and WINE else None


class TwentyLayers:
    """SHA-256 of what the model gives out after each layer; files are in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        path = export_fmu(MODEL, fmi="3", nx=SIDE, ny=SIDE, fixed=True, out=folder / f"{MODEL}.fmu")
        self._members = unpack(path)
        self._description = fmpy.read_model_description(str(path))

    def by_gcc(self, environment: Mapping[str, str]) -> str:
        """By the binary that `make` built for this machine."""
        (binary,) = (content for name, content in self._members.items() if name.startswith("binaries/"))
        return self._of(binary, None, environment)

    def by_zig(self, platform: str, environment: Mapping[str, str]) -> str:
        """By a binary for a platform that zig compiles from the sources in the FMU."""
        bare = {name: content for name, content in self._members.items() if not name.startswith("binaries/")}
        made = with_platforms(bare, "3", [platform])
        (binary,) = (content for name, content in made.items() if name.startswith("binaries/"))
        return self.by_binary(binary, platform, environment)

    def by_binary(self, binary: bytes, platform: str, environment: Mapping[str, str]) -> str:
        """By any binary of the model for a platform."""
        return self._of(binary, TARGETS[platform], environment)

    def _of(self, binary: bytes, target: Target | None, environment: Mapping[str, str]) -> str:
        folder = self._folder / (target.name if target else "native")
        folder.mkdir(exist_ok=True)
        suffix = target.suffix if target else ".so"  # Windows appends .dll to a name without one
        library, program = folder / f"{MODEL}{suffix}", compiled(target, folder / "calls.exe")
        library.write_bytes(binary)
        before = runner(target) if target else []
        assert before is not None, target
        script = script_of(self._description, VALUES, 1.0, LAYERS)
        text = answers([*before, program, "3", library, self._description.instantiationToken, ""], script, environment)
        assert len(set(text.split())) > LAYERS * SIDE
        return hashlib.sha256(text.encode()).hexdigest()
