"""JModelica, a compiler of others, on the Modelica library, and the models that it compiles."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

from support.fmus.modelica_library import LIBRARY

MODELS = [
    f"{folder}.{path.stem}"
    for folder in ("Examples", "Validation")
    for path in sorted((LIBRARY / folder).glob("*.mo"))
    if path.stem != "package"
]
"""All models that run by themselves, by their names after `InkLoop.`."""


class JModelica:
    """The Java compiler of an installed JModelica, in the folder that `JMODELICA_HOME` names (its own variable)."""

    _MAIN = "org.jmodelica.modelica.compiler.ModelicaCompiler"

    @property
    def _home(self) -> Path:
        return Path(os.environ["JMODELICA_HOME"])

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
