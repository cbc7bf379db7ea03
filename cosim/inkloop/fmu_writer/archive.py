"""Packing FMUs; at build time also the command that CMake calls.

python -m inkloop.fmu_writer.archive variables --definition variables.toml --out FOLDER
python -m inkloop.fmu_writer.archive emulated --definition variables.toml ... --out emulated_parameters.h
python -m inkloop.fmu_writer.archive pack --form fmi3 --definition variables.toml ... --out MODEL.fmu
python -m inkloop.fmu_writer.archive each COMMANDS.txt
"""

from __future__ import annotations

import argparse
import os
import sys
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from inkloop.errors import FmuError, InkloopError
from inkloop.files import replaced, write_text
from inkloop.fmu_writer import FORMS, c_tables, definition, description, documentation
from inkloop.fmu_writer.definition import ModelDefinition
from inkloop.fmu_writer.description import PLAIN, Baked, Release
from inkloop.fmu_writer.targets import ALL, platforms_in, targets_of, universal
from inkloop.limits import unpacked_error

DEFINITION = "sources/variables.toml"
"""Path in an FMU of the definition that its description is written from."""

COMPRESSION = zipfile.ZIP_DEFLATED
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the same content gives the same bytes, whenever it was packed


def pack(path: Path, members: Mapping[str, bytes]) -> None:
    """Write the archive whole or not at all; modelDescription.xml comes first."""
    with replaced(path) as partial, zipfile.ZipFile(partial, "w") as archive:
        for name in sorted(members, key=lambda name: (name != "modelDescription.xml", name)):
            info = zipfile.ZipInfo(name, _ZIP_TIME)
            info.compress_type = COMPRESSION
            info.external_attr = 0o644 << 16
            archive.writestr(info, members[name])


def unpack(path: Path) -> dict[str, bytes]:
    """Member name -> content. Raises FmuError."""
    try:
        with zipfile.ZipFile(path) as archive:
            if reason := unpacked_error(archive):
                raise FmuError(f"{path}: {reason}")
            return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    except (OSError, zipfile.BadZipFile) as error:
        raise FmuError(f"{path}: is not a readable FMU: {error}") from error


def read_definition(path: Path) -> ModelDefinition:
    """The definition in one of inkloop's FMUs. Raises FmuError."""
    return definition_in(unpack(path))


def definition_in(members: Mapping[str, bytes]) -> ModelDefinition:
    """The definition among the members of one of inkloop's FMUs. Raises FmuError."""
    return definition.load(members[DEFINITION].decode(), DEFINITION)


def described(
    members: Mapping[str, bytes], form: str, sizes: Mapping[str, int], version: str, baked: Baked = PLAIN
) -> dict[str, bytes]:
    """The members with a modelDescription.xml for `sizes` (structural parameters), from the definition among them.

    Raises FmuError if their binary would refuse it because another version of inkloop built it.
    """
    model = definition_in(members)
    if model.fingerprint.encode() not in members.get("modelDescription.xml", model.fingerprint.encode()):
        raise FmuError(
            f"{model.name}: the FMU was built from other sources than this Python code; run make, or pip install again"
        )
    written = description.write(model, form, sizes, _sources(members), Release(version, _now()), baked)
    return {**members, "modelDescription.xml": written}


def _sources(members: Mapping[str, bytes]) -> list[str]:
    return sorted(Path(name).name for name in members if name.startswith("sources/") and name.endswith(".c"))


def _now() -> str:
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    now = datetime.fromtimestamp(int(epoch), UTC) if epoch else datetime.now(UTC)
    return now.strftime("%Y-%m-%dT%H:%M:%SZ")


def _members(model: ModelDefinition, options: argparse.Namespace) -> dict[str, bytes]:
    """Everything in an FMU but its modelDescription.xml."""
    members = {f"sources/{path.name}": path.read_bytes() for path in options.sources}
    members[DEFINITION] = definition.text_of(options.definition).encode()
    members |= _binaries(model.name, options)
    members["documentation/index.html"] = documentation.index_html(model, options.readme.read_text("utf-8"))
    members["documentation/diagram.png"] = options.diagram.read_bytes()
    members["documentation/licenses/license.txt"] = options.license.read_bytes()
    if options.form == "fmi2":
        members["model.png"] = options.icon.read_bytes()
    else:
        members["terminalsAndIcons/icon.png"] = options.icon.read_bytes()
        members["terminalsAndIcons/terminalsAndIcons.xml"] = documentation.terminals_xml(model)
        if model.buses:
            members[documentation.MANIFEST] = documentation.manifest_xml()
        build = documentation.build_description_xml(model, _sources(members))
        members["sources/buildDescription.xml"] = build
    return members


def _binaries(name: str, options: argparse.Namespace) -> dict[str, bytes]:
    """The binary of --platform, or several, each with its platform in its header."""
    if len(options.binary) == 1:
        (path,) = options.binary
        return {f"binaries/{options.platform}/{name}{path.suffix}": path.read_bytes()}
    fmi = "2" if options.form == "fmi2" else "3"
    by_platform = {platform: path for path in options.binary for platform in platforms_in(path.read_bytes())}
    found = {}
    for folder, targets in targets_of([ALL], fmi).items():
        own = [by_platform[target.name] for target in targets if target.name in by_platform]
        if own:
            found[f"binaries/{folder}/{name}{targets[0].suffix}"] = universal([path.read_bytes() for path in own])
    return found


def _write_variables(options: argparse.Namespace) -> None:
    model = definition.load(definition.text_of(options.definition), options.definition)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in {**c_tables.files(model), "fmu_model.c": c_tables.fmu_model(model)}.items():
        write_text(options.out / name, text)


def _write_emulated(options: argparse.Namespace) -> None:
    models = [definition.load(definition.text_of(path), path) for path in options.definition]
    write_text(options.out, c_tables.emulated_parameters(models))


def _pack(options: argparse.Namespace) -> None:
    model = definition.load(definition.text_of(options.definition), options.definition)
    members = described(_members(model, options), options.form, model.sizes({}), options.version)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    pack(options.out, members)


def _each(options: argparse.Namespace) -> None:
    for words in options.commands.read_text("utf-8").rstrip("\n").split("\n\n"):
        each = _parser().parse_args(words.split("\n"))
        each.command(each)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m inkloop.fmu_writer.archive")
    commands = parser.add_subparsers(required=True)
    variables = commands.add_parser("variables", help="write header and table of the variables, fmu_model.c")
    variables.set_defaults(command=_write_variables)
    emulated = commands.add_parser("emulated", help="write the rows of the emulator's options that are parameters")
    emulated.set_defaults(command=_write_emulated)
    emulated.add_argument("--definition", type=Path, nargs="+", required=True)
    packing = commands.add_parser("pack", help="pack one FMU of the default set")
    packing.set_defaults(command=_pack)
    packing.add_argument("--form", choices=FORMS, required=True)
    packing.add_argument("--platform", required=True, help="folder below binaries/ of a single binary")
    packing.add_argument("--binary", type=Path, nargs="+", required=True)
    packing.add_argument("--version", required=True)
    packing.add_argument("--sources", type=Path, nargs="+", required=True)
    for name in ("readme", "icon", "diagram", "license"):
        packing.add_argument(f"--{name}", type=Path, required=True)
    several = commands.add_parser("each", help="run the commands of a file in one process")
    several.set_defaults(command=_each)
    several.add_argument("commands", type=Path, help="a word a line, and an empty line after each command")
    for command in (variables, packing):
        command.add_argument("--definition", type=Path, required=True, help="variables.toml of the model")
    for command in (variables, emulated, packing):
        command.add_argument("--out", type=Path, required=True)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command of the build."""
    options = _parser().parse_args(arguments)
    try:
        options.command(options)
    except InkloopError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
