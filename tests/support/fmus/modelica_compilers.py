"""Results of third-party compilers on the Modelica library: files read, models compiled, models run, messages."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pymoca.parser
import rumoca

from support.fmus.modelica_library import LIBRARY, compiled, simulate, stop_time
from support.masters.other_programs import Program, PythonPackage

FILES = sorted(LIBRARY.rglob("*.mo"))
MODELS = [
    f"{folder}.{path.stem}"
    for folder in ("Examples", "Validation")
    for path in sorted((LIBRARY / folder).glob("*.mo"))
    if path.stem != "package"
]
"""All models that run by themselves, by their names after `InkLoop.`."""


@dataclass(frozen=True)
class Outcome:
    """Files and models that a compiler took, None: it was not asked; and its messages."""

    files: int | None
    compiled: int | None
    run: int | None
    messages: Sequence[str] = field(default_factory=tuple)


class JModelica:
    """The Java compiler of an installed JModelica, in the folder that `JMODELICA_HOME` names (its own variable)."""

    _MAIN = "org.jmodelica.modelica.compiler.ModelicaCompiler"

    @property
    def _home(self) -> Path:
        return Path(os.environ["JMODELICA_HOME"])

    @property
    def version(self) -> str:
        """As its installation says."""
        return (self._home / "version.txt").read_text(encoding="utf-8").strip()

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""
        if not os.environ.get("JMODELICA_HOME"):
            return "JMODELICA_HOME is not set: there is no JModelica, which no package registry has"
        if not (self._home / "lib" / "ModelicaCompiler.jar").is_file():
            return f"{self._home} has no lib/ModelicaCompiler.jar: JMODELICA_HOME is not the folder of a JModelica"
        if shutil.which("java") is None:
            return "java is not installed; Debian has it in default-jre-headless (make tools)"
        return ""

    def copy_of_library(self, folder: Path) -> Path:
        """The library as it reads it: its grammar is older than `pure function` (Modelica 3.3), the default."""
        copy = shutil.copytree(LIBRARY, folder / LIBRARY.name)
        for file in copy.rglob("*.mo"):
            file.write_text(re.sub(r"^pure function", "function", file.read_text(), flags=re.MULTILINE))
        return copy

    def compile(self, library: Path, model: str) -> list[str]:
        """Flatten, check and sort the equations, as before its code generation; errors and warnings, one line each.

        Raises ValueError with the errors.
        """
        jars = [*sorted((self._home / "lib").glob("*.jar")), self._home / "ThirdParty/Beaver/lib/beaver-rt.jar"]
        java = ["java", "-cp", os.pathsep.join(map(str, jars)), self._MAIN]
        options = ["-log=w", f"-modelicapath={library.parent}", "-target=nocodegen"]
        done = subprocess.run(
            [*java, *options, str(library), f"InkLoop.{model}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        parts = re.split(r"^(?=Warning |Error )", done.stdout, flags=re.MULTILINE)
        messages = [" ".join(part.split()) for part in parts if part.strip()]
        if done.returncode or not all(message.startswith("Warning ") for message in messages):
            raise ValueError(f"InkLoop.{model}: {' '.join(messages)}")
        return [re.sub(r"^Warning at .*?, in file '.*?'[,:] (In component \w+: )?", "", each) for each in messages]


JMODELICA = JModelica()


def by_rumoca(folder: Path) -> Outcome:
    """Files, models and runs to their stop times; the assertions of the models stop a run that is wrong."""
    read = sum(not rumoca.validate(str(file)) for file in FILES)
    taken = sum(compiled(model).structure().is_balanced for model in MODELS)
    return Outcome(read, taken, sum(simulate(model, stop_time(model)).end == stop_time(model) for model in MODELS))


def by_pymoca(folder: Path) -> Outcome:
    """Files: its translator has no `when` with arrays and no functions with loops."""
    return Outcome(sum(pymoca.parser.parse(file.read_text()) is not None for file in FILES), None, None)


def by_jmodelica(folder: Path) -> Outcome:
    """Models; the files are those that they need."""
    library, taken, messages = JMODELICA.copy_of_library(folder), 0, []
    for model in MODELS:
        try:
            messages += JMODELICA.compile(library, model)
            taken += 1
        except ValueError as error:
            messages.append(str(error))
    return Outcome(None, taken, None, messages)


@dataclass(frozen=True)
class ModelicaCompiler:
    """A compiler of others; `read` works in a folder of its own."""

    name: str
    program: Program
    read: Callable[[Path], Outcome]


COMPILERS = (
    ModelicaCompiler("rumoca", PythonPackage("rumoca", "rumoca"), by_rumoca),
    ModelicaCompiler("pymoca, its parser", PythonPackage("pymoca", "pymoca.parser"), by_pymoca),
    ModelicaCompiler("JModelica, up to code generation", JMODELICA, by_jmodelica),
)
