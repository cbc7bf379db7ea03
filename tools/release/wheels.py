"""A wheel for one platform: all C of the project by `zig cc`, FMUs with binaries for every platform."""

from __future__ import annotations

from pathlib import Path

import ziglang
from tools.release.sources import call_backend, run

from inkloop.errors import InkloopError
from inkloop.fmu_writer.targets import Target

BINARIES = "fmu_binaries"
"""The CMake target of the libraries in the FMUs."""


def compile_binaries(target: Target, source: Path, builds: Path) -> None:
    """Compile what goes into the FMUs, in the folder that the wheel for this platform is built in afterwards."""
    build = builds / target.name
    defined = [f"-D{name}={value}" for name, value in definitions(target, source).items()]
    # the version is not in these binaries; with a wheel it comes from the back end
    defined += ["-DCMAKE_BUILD_TYPE=Release", "-DSKBUILD_PROJECT_VERSION=0"]
    run(["cmake", "-G", "Ninja", "-S", str(source), "-B", str(build), *defined], source, {})
    run(["cmake", "--build", str(build), "--target", BINARIES], source, {})


def build_wheel(target: Target, source: Path, builds: Path, folder: Path, epoch: int) -> Path:
    """The wheel, made in `folder`, with the FMU binaries of all platforms that were compiled before."""
    defined = {**definitions(target, source), "INKLOOP_BINARIES": str(builds)}
    settings = {
        "build-dir": str(builds / target.name),
        "install.strip": "false",  # the linker did it
        "wheel.reproducible": "true",
        **{f"cmake.define.{name}": value for name, value in defined.items()},
    }
    # scikit-build-core, like sysconfig, reads from it the platform of the Python that will load the wheel
    environment = {"SOURCE_DATE_EPOCH": str(epoch), "_PYTHON_HOST_PLATFORM": target.wheel}
    call_backend("build_wheel", source, folder, settings, environment)
    found = list(folder.glob(f"*-py3-none-{target.wheel}.whl"))
    if len(found) != 1:
        raise InkloopError(f"{folder} has {len(found)} wheels for {target.wheel}; expected one")
    return found[0]


def definitions(target: Target, source: Path) -> dict[str, str]:
    """Variables that the toolchain file reads."""
    return {
        "CMAKE_TOOLCHAIN_FILE": str(source / "tools/release/zig.cmake"),
        "INKLOOP_ZIG": str(Path(ziglang.__file__).parent / "zig"),
        "INKLOOP_TRIPLE": target.triple,
        "INKLOOP_SYSTEM": target.system,
        "INKLOOP_PROCESSOR": target.name.partition("-")[0],
    }
