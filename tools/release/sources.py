"""The source distribution that all wheels of a release are built from, and the time that its files carry."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from inkloop.errors import InkloopError

ROOT = Path(__file__).parents[2]
FOREIGN = ("CC", "CFLAGS", "CPPFLAGS", "LDFLAGS", "CMAKE_ARGS", "CMAKE_GENERATOR", "SKBUILD_CMAKE_ARGS", "PYTHONPATH")
"""What of the environment could change the files of a release."""


def source_epoch(root: Path) -> int:
    """Seconds since 1970 that files of the release carry. Raises InkloopError where nothing says them."""
    if named := os.environ.get("SOURCE_DATE_EPOCH"):
        if not named.isdecimal():
            raise InkloopError(f"SOURCE_DATE_EPOCH is {named!r}; expected a whole number of seconds since 1970")
        return int(named)
    command = ["git", "log", "-1", "--format=%ct"]
    try:
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
        return int(done.stdout)
    except (OSError, ValueError, subprocess.CalledProcessError) as error:
        raise InkloopError(
            f"{root} has no commit whose time the files could carry; set SOURCE_DATE_EPOCH, in seconds since 1970"
        ) from error


def build_sdist(root: Path, folder: Path, epoch: int) -> Path:
    """The source distribution of a working tree, made in `folder`. Raises InkloopError."""
    call_backend("build_sdist", root, folder, {"sdist.reproducible": "true"}, {"SOURCE_DATE_EPOCH": str(epoch)})
    (sdist,) = folder.glob("*.tar.gz")
    return sdist


def unpacked(sdist: Path, folder: Path) -> Path:
    """The root of the source distribution, unpacked into `folder`."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    return folder / sdist.name.removesuffix(".tar.gz")


def call_backend(
    hook: str, root: Path, folder: Path, settings: Mapping[str, str], environment: Mapping[str, str]
) -> None:
    """Call a hook of PEP 517, with the packages of this environment. Raises InkloopError with its last words."""
    code = (
        "import json, sys; import scikit_build_core.build as backend; "
        "getattr(backend, sys.argv[1])(sys.argv[2], json.loads(sys.argv[3]))"
    )
    run([sys.executable, "-c", code, hook, str(folder), json.dumps(settings)], root, environment)


def run(command: Sequence[str], folder: Path, environment: Mapping[str, str]) -> None:
    """Run a program of the build, without what would change its result. Raises InkloopError with its last lines."""
    bin_folder = os.fspath(Path(sys.executable).parent)
    inherited = {name: value for name, value in os.environ.items() if name not in FOREIGN}
    path = os.pathsep.join((bin_folder, os.environ.get("PATH", os.defpath)))
    whole = {**inherited, "PATH": path, **environment}
    done = subprocess.run(command, cwd=folder, env=whole, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-40:])
        raise InkloopError(f"{Path(command[0]).name} ended with {done.returncode}:\n{last}")
