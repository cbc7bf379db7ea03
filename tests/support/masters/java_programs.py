"""Fetch the Java programs of other people that tests run, from Maven Central into build/java.

Run as a script by `make tools`, before anything is installed: standard library only.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import urllib.request
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

CENTRAL = "https://repo1.maven.org/maven2"
KEPT = Path(__file__).parents[3] / "build" / "java"


@dataclass(frozen=True)
class Jar:
    """A file of Maven Central. kept_as: its name here; unpacked: its contents have to lie next to it as files."""

    path: str
    sha256: str
    kept_as: str
    unpacked: bool = False

    def fetch(self, folder: Path) -> None:
        """Raises OSError without a network, or where the file is not the one that is expected."""
        address = f"{CENTRAL}/{self.path}"
        with urllib.request.urlopen(address, timeout=60) as answer:
            content = answer.read()
        found = hashlib.sha256(content).hexdigest()
        if found != self.sha256:
            raise OSError(
                f"{address}: SHA-256 is {found}; expected {self.sha256}: do not use it, look what has changed"
            )
        (folder / self.kept_as).write_bytes(content)
        if self.unpacked:
            with zipfile.ZipFile(folder / self.kept_as) as archive:
                archive.extractall(folder)


@dataclass(frozen=True)
class JavaProgram:
    """A program of several jars; the first one is run."""

    name: str
    version: str
    jars: Sequence[Jar]

    @property
    def folder(self) -> Path:
        return KEPT / f"{self.name}-{self.version}"

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""
        if shutil.which("java") is None:
            return "java is not installed; Debian has it in default-jre-headless (make tools)"
        if not self.folder.is_dir():
            return f"{self.name} {self.version} is not in {KEPT}; make peers fetches it from Maven Central"
        return ""

    def fetch(self) -> None:
        """All jars, or nothing. Raises OSError."""
        if self.folder.is_dir():
            return
        partial = self.folder.with_name(f".{self.folder.name}.part")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        for jar in self.jars:
            jar.fetch(partial)
        partial.rename(self.folder)

    def run(self, main_class: str, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
        """Run in a folder, which is where it may leave files; its output is one text."""
        command = ["java", "-cp", str(self.folder / self.jars[0].kept_as), main_class, *arguments]
        return subprocess.run(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )


MAESTRO = JavaProgram(
    "maestro",
    "3.1.1",
    [
        Jar(
            "org/into-cps/maestro/maestro/3.1.1/maestro-3.1.1-jar-with-dependencies.jar",
            "f996cd5d2adc0fed4260185efd24e75730b867e8bce1980c694e58e692251b89",
            "maestro.jar",
        )
    ],
)
_CHECK = "org/into-cps/vdmcheck"
VDM_CHECK = JavaProgram(
    "vdmcheck2",
    "1.1.3",
    [
        Jar(
            f"{_CHECK}/fmi2/vdmcheck2/1.1.3/vdmcheck2-1.1.3.jar",
            "45baf392a6af374cdb8f32544de10779a31659b90c4caeca17082a6f0de5acea",
            "vdmcheck2.jar",
            unpacked=True,
        ),
        Jar(
            f"{_CHECK}/fmi2/rule-model/1.1.3/rule-model-1.1.3.jar",
            "df8dc1c6b8b1686a0a78fa9d51f480d87c51ff26415c75dfb90743178ae026ea",
            "rule-model.jar",
            unpacked=True,
        ),
        Jar(
            f"{_CHECK}/xsd2vdm/1.1.3/xsd2vdm-1.1.3.jar",
            "4eb6ecaa3b3825128b35b310591c111003c97d710bd74e9e9da04d4d6f33576b",
            "xsd2vdm.jar",
        ),
        Jar(
            f"{_CHECK}/fmuReader/1.1.3/fmuReader-1.1.3.jar",
            "8b3de7857441d1ef6a2d64764d65ed84026c2c023ec5f86380107ccdfdd2a901",
            "fmuReader.jar",
        ),
        Jar(
            "dk/au/ece/vdmj/vdmj/4.5.0/vdmj-4.5.0.jar",
            "a7d9e2f9cbbc31ca81caccb9d3ca258ae7417582efa82ab48f4a0a35e56286ce",
            "vdmj.jar",
        ),
        Jar(
            "dk/au/ece/vdmj/annotations/4.5.0/annotations-4.5.0.jar",
            "e92636eee07370a8677aa90fb42b0dff4a2b546f4a3413701933f591404b4ae1",
            "annotations.jar",
        ),
    ],
)
"""It starts itself once more and looks next to its own jar for the others and the models in them, by these names."""


def main() -> None:
    """Fetch both, or give the reason why not."""
    if shutil.which("java") is None:
        print("java is not installed (make tools): Maestro and VDMCheck2 were not fetched", file=sys.stderr)
        return
    for program in (MAESTRO, VDM_CHECK):
        try:
            program.fetch()
        except OSError as error:
            print(f"{program.name} {program.version} was not fetched: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
