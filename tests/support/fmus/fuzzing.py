"""The fuzz targets: inputs of the firmware and calls of the FMUs, built with sanitizers, run by libFuzzer where there
is one, else fed with inputs.

PYTHONPATH=tests python -m support.fmus.fuzzing [--seconds N] [target ...]

runs libFuzzer for so many seconds over all targets together. What it learns stays in build/fuzz; an input that violates
an invariant or is caught by a sanitizer is kept there and named. Correct the firmware, then add the input, small and
named after what it found, to tests/fuzz/firmware/corpus; what an FMU did becomes a test in
contract/test_fmu_fuzz.py.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Self

from support.benches.node_bench import CORE, PLACES, ROOT, WIRE, codec
from support.compiled import compile_kept, run

TARGETS = ("frames", "isotp", "services", "slcan")
PARTS = ("asking", "board", "invariants", "requests", "wire")
FUZZ = ROOT / "tests" / "fuzz" / "firmware"
CORPUS = FUZZ / "corpus"
CLANGS = ("clang", *(f"clang-{version}" for version in range(22, 13, -1)))
FLAGS = ("-std=c11", "-g1", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror", "-ffp-contract=off")
SANITIZERS = "-fsanitize=address,undefined"
LONGEST_INPUT = 400
INPUT_SECONDS = 20  # one input that takes longer hangs


def clang() -> str | None:
    """A clang with libFuzzer; None where there is none."""
    found = next((name for name in CLANGS if shutil.which(name)), None)
    if found is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "nothing.c"
        source.write_text(
            "int LLVMFuzzerTestOneInput(const char *b, unsigned long n) { return n > 9 && *b ? 0 : 0; }\n"
        )
        link: list[str | Path] = [found, f"{SANITIZERS},fuzzer", source, "-o", Path(folder) / "nothing"]
        return found if subprocess.run(link, capture_output=True, check=False).returncode == 0 else None


def build(folder: Path, compiler: str = "gcc", *, fuzzer: bool = False) -> dict[str, Path]:
    """The program of every target: with libFuzzer in it, or with `replay.c`; RuntimeError with the compiler's words."""
    sanitizers = (f"{SANITIZERS},fuzzer-no-link" if fuzzer else SANITIZERS, "-fno-sanitize-recover=all")
    optimized = ("-O1",) if fuzzer else ("-O0",)  # a replay is compiled longer than it runs
    flags = (*FLAGS, *optimized, *sanitizers, f"-I{FUZZ}", *PLACES, f"-isystem{codec()}")
    shared = [*CORE, *WIRE, codec() / "inkloop.c", *(FUZZ / f"{name}.c" for name in PARTS)]
    driver = () if fuzzer else (FUZZ / "replay.c",)
    own = [FUZZ / f"{target}.c" for target in TARGETS]

    def compiled(source: Path) -> Path:
        path = folder / f"{source.parent.name}-{source.stem}.o"
        compile_kept(source, path, flags, compiler)
        return path

    with ThreadPoolExecutor(2) as pool:
        objects = dict(zip((*shared, *driver, *own), pool.map(compiled, (*shared, *driver, *own)), strict=True))
    programs = {}
    for target, source in zip(TARGETS, own, strict=True):
        programs[target] = folder / f"fuzz-{target}"
        parts = [objects[part] for part in (source, *shared, *driver)]
        last = (f"{SANITIZERS},fuzzer",) if fuzzer else (SANITIZERS,)
        run((compiler, *last, *parts, "-lm", "-o", programs[target]))
    return programs


def corpus(target: str) -> list[Path]:
    return sorted((CORPUS / target).iterdir())


class Replay:
    """A target as a process that is fed inputs; one that violates an invariant ends it."""

    def __init__(self, program: Path) -> None:
        self.program = program
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> str:
        """Output of the process before it ended."""
        if self.process is None:
            return ""
        process, self.process = self.process, None
        output = process.communicate()[1].decode(errors="replace")
        return output or f"the process ended with {process.returncode}" if process.returncode else output

    def feed(self, given: bytes) -> str:
        """'' if all invariants held, else the message."""
        if self.process is None:
            pipe = subprocess.PIPE
            self.process = subprocess.Popen([self.program], stdin=pipe, stdout=pipe, stderr=pipe)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(len(given).to_bytes(2, "little") + given)
        self.process.stdin.flush()
        return "" if self.process.stdout.read(1) else self.end() or "the process ended without a word"


def fuzz(target: str, program: Path, seconds: int, learned: Path, *, seed: int = 0, table: Path | None = None) -> str:
    """'' if libFuzzer found nothing, else its report; `learned` keeps the inputs that reached something new.

    `table` describes the FMU whose calls are the target; without it the target is one of the firmware.
    """
    learned.mkdir(parents=True, exist_ok=True)
    found = learned.parent / f"{target}-found-"
    options = (f"-max_total_time={seconds}", f"-max_len={LONGEST_INPUT}", f"-timeout={INPUT_SECONDS}", f"-seed={seed}")
    seeds = [CORPUS / target] if table is None else ["-len_control=0"]
    command = [program, *options, "-print_final_stats=1", f"-artifact_prefix={found}", learned, *seeds]
    settings = {} if table is None else {"INKLOOP_FMU_TABLE": str(table)}
    done = subprocess.run(
        command, env=os.environ | settings, capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode:
        return f"{target}:\n{done.stderr}"
    runs = [line.split()[-1] for line in done.stderr.splitlines() if line.startswith("stat::number_of_executed_units")]
    print(f"{target}: {''.join(runs)} inputs, nothing found", flush=True)
    return ""


def main(arguments: Sequence[str]) -> int:
    from support.fmus import fmu_library

    known = (*TARGETS, *fmu_library.NAMES)
    parser = argparse.ArgumentParser(description="Fuzzes the inputs of the firmware and the calls of the FMUs.")
    parser.add_argument("targets", nargs="*", default=known, help=", ".join(known))
    parser.add_argument("--seconds", type=int, default=1200, help="over all targets together (1200)")
    chosen = parser.parse_args(arguments)
    unknown = sorted(set(chosen.targets) - set(known))
    if unknown:
        parser.error(f"no such target: {', '.join(unknown)}; there are {', '.join(known)}")
    compiler = clang()
    if compiler is None:
        print("clang with libFuzzer is not installed: nothing was fuzzed; make tools")
        return 0
    place = ROOT / "build" / "fuzz"
    place.mkdir(parents=True, exist_ok=True)
    seconds = max(1, chosen.seconds // len(chosen.targets))
    with tempfile.TemporaryDirectory(prefix="inkloop-fuzz-") as folder:
        programs = build(Path(folder), compiler, fuzzer=True)
        fmus = [target for target in chosen.targets if target not in TARGETS]
        calls, tables = fmu_library.fuzzers(fmus, Path(folder), compiler)
        seed = int.from_bytes(os.urandom(3), "little") + 1
        reports = [
            fuzz(target, programs.get(target, calls), seconds, place / target, seed=seed, table=tables.get(target))
            for target in chosen.targets
        ]
    print("\n".join(filter(None, reports)), end="")
    return 1 if any(reports) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
