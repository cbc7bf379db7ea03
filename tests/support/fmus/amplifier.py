"""Builds tests/c/amplifier_fmu.c into an FMU that shares nothing with those of this project."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy

from support import compiled
from support.places import C_SOURCES

SOURCE = C_SOURCES / "amplifier_fmu.c"
_COMMON = 'modelName="Amplifier" description="Foreign FMU" generationTool="gcc" license="none"'
_MODES = '<Item name="plain" value="1"/><Item name="squared" value="2"/>'


def build(folder: Path, fmi: int, *, platform: str | None = None, crashes: str = "") -> Path:
    """Compile and pack; `platform` names the folder of the binary.

    `crashes` names a signal that the step after the third raises.
    """
    name = f"amplifier{fmi}{f'-{crashes}' if crashes else ''}"
    flags = ("-std=c11", "-Wall", "-Wextra", "-Werror", "-fPIC", f"-DFMI={fmi}")
    made = compiled.object_of(SOURCE, (*flags, f"-DCRASHES={crashes}") if crashes else flags)
    library = compiled.linked(f"{name}.so", [made], ("-shared",))
    path = folder / f"{name}{platform or ''}.fmu"
    place = platform or (fmpy.platform if fmi == 2 else fmpy.platform_tuple)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", _fmi2() if fmi == 2 else _fmi3())
        archive.write(library, f"binaries/{place}/amplifier.so")
    return path


def altered(fmu: Path, path: Path, *changes: tuple[str, str]) -> Path:
    """A copy of an FMU at `path` whose description has other text: pairs of what it holds and what replaces that."""
    with zipfile.ZipFile(fmu) as ours, zipfile.ZipFile(path, "w") as theirs:
        for name in ours.namelist():
            content = ours.read(name)
            if name == "modelDescription.xml":
                text = content.decode()
                for found, replacement in changes:
                    assert found in text
                    text = text.replace(found, replacement)
                content = text.encode()
            theirs.writestr(name, content)
    return path


def _fmi3() -> str:
    return f"""<fmiModelDescription fmiVersion="3.0" {_COMMON} instantiationToken="amplifier">
<CoSimulation modelIdentifier="amplifier" canGetAndSetFMUState="true" canSerializeFMUState="true"/>
<TypeDefinitions><EnumerationType name="Mode">{_MODES}</EnumerationType></TypeDefinitions>
<ModelVariables>
<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="3"/>
<Boolean name="half" valueReference="2" causality="structuralParameter" variability="fixed" start="false"/>
<Boolean name="on" valueReference="3" causality="input" start="true"/>
<Float64 name="gain" valueReference="4" causality="parameter" variability="fixed" start="2" min="0" max="10"/>
<Enumeration name="mode" valueReference="5" causality="parameter" variability="fixed" declaredType="Mode" start="1"/>
<Int32 name="count" valueReference="6" causality="output"/>
<String name="label" valueReference="7" causality="parameter" variability="fixed"><Start value="a b"/></String>
<Float64 name="x" valueReference="100" causality="input" unit="m" start="0"><Dimension valueReference="1"/></Float64>
<Float64 name="y" valueReference="200" causality="output" unit="m"><Dimension valueReference="1"/></Float64>
<Boolean name="high" valueReference="300" causality="output"><Dimension valueReference="1"/></Boolean>
</ModelVariables><ModelStructure/></fmiModelDescription>"""


def _fmi2() -> str:
    fixed = 'causality="parameter" variability="fixed"'
    flag = 'causality="output" variability="discrete"'
    arrays = "".join(
        _scalar(f"x[{i}]", 99 + i, 'causality="input"', '<Real unit="m" start="0"/>')
        + _scalar(f"y[{i}]", 199 + i, 'causality="output"', '<Real unit="m"/>')
        + _scalar(f"high[{i}]", 299 + i, flag, "<Boolean/>")
        for i in (3, 1, 2)  # any order will do
    )
    return f"""<fmiModelDescription fmiVersion="2.0" {_COMMON} guid="amplifier" variableNamingConvention="structured">
<CoSimulation modelIdentifier="amplifier" canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>
<TypeDefinitions><SimpleType name="Mode"><Enumeration>{_MODES}</Enumeration></SimpleType></TypeDefinitions>
<ModelVariables>
{_scalar("on", 3, 'causality="input" variability="discrete"', '<Boolean start="true"/>')}
{_scalar("gain", 4, fixed, '<Real start="2" min="0" max="10"/>')}
{_scalar("mode", 5, fixed, '<Enumeration declaredType="Mode" start="1"/>')}
{_scalar("count", 6, flag, "<Integer/>")}
{_scalar("label", 7, fixed, '<String start="a b"/>')}
{arrays}
</ModelVariables><ModelStructure/></fmiModelDescription>"""


def _scalar(name: str, reference: int, attributes: str, kind: str) -> str:
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {attributes}>{kind}</ScalarVariable>'
