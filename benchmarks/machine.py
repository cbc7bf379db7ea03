"""The machine that a benchmark runs on, without its name, and the versions of what it compares."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.timing import timed
from inkloop.limits import GIB
from inkloop.units import GIGA

PACKAGES = ("inkloop", "numpy", "numba", "fmpy", "libcosimpy", "trimesh")
LEVELS = (("avx512f", "AVX-512"), ("avx2", "AVX2"), ("sse4_2", "SSE4.2"))
_CELLS, _SIDE, _ROUNDS = 1 << 24, 512, 7


def described() -> dict[str, str]:
    """Cores, instruction set, memory; bandwidth of a copy and of a triad, and arithmetic, on one core."""
    copy, triad = bandwidths()
    return {
        "processor": f"{platform.machine()}, {_level()}",
        "cores": str(os.cpu_count()),
        "memory": f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / GIB:.0f} GiB",
        "copy, one core": f"{copy / GIGA:.1f} GB/s",
        "triad, one core": f"{triad / GIGA:.1f} GB/s",
        "product of matrices, one core": f"{arithmetic() / GIGA:.1f} Gflop/s",
        "system": platform.system(),
        "Python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """Package -> version; "not installed" for those that a benchmark leaves out."""
    return {name: _version(name) for name in PACKAGES}


def bandwidths() -> tuple[float, float]:
    """Bytes per second of processor time that a copy and a triad a = b + s c read and write (McCalpin, STREAM)."""
    a, b, c = (np.full(_CELLS, value) for value in (0.0, 1.0, 2.0))

    def triad() -> None:
        np.multiply(c, 3.0, out=a)
        np.add(a, b, out=a)

    bytes_of_copy, bytes_of_triad = 2 * a.nbytes, 5 * a.nbytes  # NumPy writes a, then reads and writes it again
    return bytes_of_copy / _seconds(lambda: np.copyto(a, b)), bytes_of_triad / _seconds(triad)


def arithmetic() -> float:
    """Multiplications and additions per second of processor time, by a product of matrices in the cache."""
    a = np.random.default_rng(0).random((_SIDE, _SIDE))
    return 2.0 * _SIDE**3 / _seconds(lambda: a @ a)


def _seconds(call: Callable[[], object]) -> float:
    call()
    return median(max(timed(call).processor_s, 1e-9) for _ in range(_ROUNDS))


def _level() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    flags = cpuinfo.read_text(encoding="ascii", errors="replace").split() if cpuinfo.exists() else []
    return next((name for flag, name in LEVELS if flag in flags), "instruction set unknown")


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
