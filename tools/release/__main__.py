"""Build a release: python -m tools.release [--out DIR] [PLATFORM ...] (`make release`).

Source distribution, a wheel for each platform, their SHA-256 sums and an SBOM. All C is compiled on this machine by
`zig cc`, from the unpacked source distribution. The same sources and $SOURCE_DATE_EPOCH (without it: the time of the
commit) give the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from tools.release.contents import SUMS, check_wheel, earlier_files
from tools.release.sbom import write_sbom
from tools.release.sources import ROOT, build_sdist, source_epoch, unpacked
from tools.release.wheels import build_wheel, compile_binaries

from inkloop.errors import InkloopError
from inkloop.files import write_text
from inkloop.fmu_writer.targets import ALL, targets_of


def release(platforms: Iterable[str], out: Path) -> list[Path]:
    """Write the release into `out`, in place of an earlier one; returns its files. Raises InkloopError.

    The FMUs in each wheel have binaries for all of the platforms.
    """
    targets = [target for each in targets_of(platforms, "3").values() for target in each]
    epoch = source_epoch(ROOT)
    earlier = earlier_files(out)
    with tempfile.TemporaryDirectory(prefix="inkloop-release-") as name:
        work, made = Path(name), Path(name, "made")
        made.mkdir()
        say("source distribution ...")
        sdist = build_sdist(ROOT, made, epoch)
        source = unpacked(sdist, work / "source")
        for target in targets:
            say(f"FMUs for {target.name} ... (the first time zig also builds the C library: minutes)")
            compile_binaries(target, source, work / "builds")
        for target in targets:
            say(f"wheel for {target.name} ...")
            check_wheel(build_wheel(target, source, work / "builds", made, epoch), target, targets)
        write_sbom(ROOT, made, epoch)
        sums = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(made.iterdir())}
        write_text(made / SUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))
        out.mkdir(parents=True, exist_ok=True)
        for path in earlier:
            path.unlink()
        return [Path(shutil.move(path, out / path.name)) for path in sorted(made.iterdir())]


def say(text: str) -> None:
    """Show progress."""
    print(f"release: {text}", file=sys.stderr, flush=True)


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.release", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "build/release", help="folder; default: build/release")
    parser.add_argument("platforms", nargs="*", metavar="PLATFORM", help="for example aarch64-linux; default: all")
    options = parser.parse_args()
    try:
        files = release(options.platforms or [ALL], options.out)
    except InkloopError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    for path in files:
        print(f"{path.stat().st_size:>12,}  {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
