"""Further files in an FMU: documentation, terminals, build description."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from html import escape

from inkloop.fmu_writer.definition import ModelDefinition, VariableDefinition
from inkloop.fmu_writer.description import add, to_bytes

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: sans-serif; max-width: 60em; margin: 2em auto; line-height: 1.4 }}
table {{ border-collapse: collapse }} td, th {{ border: 1px solid #999; padding: 0.2em 0.5em; text-align: left }}
pre {{ background: #eee; padding: 0.5em }}
</style>
</head>
<body>
{body}
</body>
</html>
"""

_VARIABLES = '<h2>Variables</h2>\n<p><img src="diagram.png" alt="Inputs and outputs; thick arrows are maps"></p>'

BUS_TERMINAL = ("org.fmi-ls-bus.network-terminal", "org.fmi-ls-bus.transceiver")
"""Kind and matching rule of a terminal that is a bus (FMI-LS-BUS, Network Abstraction)."""

MANIFEST = "extra/org.fmi-standard.fmi-ls-bus/fmi-ls-manifest.xml"
_LS_BUS = {
    "fmi-ls-name": "org.fmi-standard.fmi-ls-bus",
    "fmi-ls-version": "1.0.0",
    "fmi-ls-description": "Layered Standard for the simulation of bus communication on a Physical Signal Abstraction "
    "or Network Abstraction based level.",
}


def index_html(model: ModelDefinition, readme: str) -> bytes:
    """documentation/index.html: the model's readme and a table of its variables."""
    body = "\n".join([*_paragraphs(readme), _VARIABLES, *_table(model)])
    return _PAGE.format(title=escape(model.name), body=body).encode()


def with_section(index: bytes, section: str, model: ModelDefinition) -> bytes:
    """A page of `index_html` with one more section, and the table of the variables as `model` has them."""
    before, _, _ = index.decode().partition(_VARIABLES)
    _, _, end = _PAGE.rpartition("{body}")
    return "\n".join([before + section, _VARIABLES, *_table(model)]).encode() + end.encode()


def terminals_xml(model: ModelDefinition) -> bytes:
    """terminalsAndIcons.xml (FMI 3): the signals of the layer contract, grouped so that whole terminals connect."""
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = add(root, "GraphicalRepresentation")
    add(graphics, "CoordinateSystem", x1=-100, y1=-100, x2=100, y2=100, suggestedScalingFactorTo_mm=0.1)
    add(graphics, "Icon", x1=-100, y1=-100, x2=100, y2=100)
    terminals = add(root, "Terminals")
    for name, description in {**model.terminals, **model.buses}.items():
        kind, rule = BUS_TERMINAL if name in model.buses else (None, "bus")
        terminal = add(terminals, "Terminal", name=name, matchingRule=rule, terminalKind=kind, description=description)
        for v in model.exposed:
            if v.terminal == name:
                add(terminal, "TerminalMemberVariable", variableName=v.name, memberName=v.name, variableKind="signal")
    return to_bytes(root)


def manifest_xml() -> bytes:
    """fmi-ls-manifest.xml of FMI-LS-BUS, for an FMU that is a node on its buses."""
    space = "http://fmi-standard.org/fmi-ls-manifest"
    ET.register_namespace("fmi-ls", space)
    attributes = {f"{{{space}}}{name}": value for name, value in _LS_BUS.items()}
    return to_bytes(ET.Element("fmiLayeredStandardManifest", {**attributes, "isBusSimulationFMU": "false"}))


def build_description_xml(model: ModelDefinition, sources: Sequence[str]) -> bytes:
    """sources/buildDescription.xml (FMI 3): the C files of the binary."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = add(root, "BuildConfiguration", modelIdentifier=model.name)
    files = add(configuration, "SourceFileSet", language="C11")
    for source in sources:
        add(files, "SourceFile", name=source)
    return to_bytes(root)


def _paragraphs(markdown: str) -> Iterator[str]:
    """The subset of Markdown in the readme files: headings, paragraphs, lists, indented code, `code`."""
    for block in re.split(r"\n\s*\n", markdown.strip("\n")):
        if heading := re.fullmatch(r"(#+) (.*)", block):
            level = len(heading[1])
            yield f"<h{level}>{_inline(heading[2])}</h{level}>"
        elif block.startswith("    "):
            yield "<pre>" + escape(re.sub(r"(?m)^ {4}", "", block)) + "</pre>"
        elif block.startswith("- "):
            items = re.split(r"(?m)^- ", block)[1:]
            yield "<ul>" + "".join(f"<li>{_inline(item)}</li>" for item in items) + "</ul>"
        else:
            yield f"<p>{_inline(block)}</p>"


def _inline(text: str) -> str:
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text.strip()))


def _table(model: ModelDefinition) -> Iterator[str]:
    yield "<table><tr><th>name</th><th>causality</th><th>type</th><th>unit</th><th>start</th><th>description</th></tr>"
    for v in model.exposed:
        cells = (v.name, v.causality, _type(model, v), v.unit, "" if v.causality == "output" else v.start, _about(v))
        yield "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in cells) + "</tr>"
    yield "</table>"


def _type(model: ModelDefinition, variable: VariableDefinition) -> str:
    name = variable.type
    if variable.declared is not None:
        items = model.types[variable.declared].items
        name = ", ".join(f"{number} {item}" for item, number in items.items())
    return f"{name} ({', '.join(variable.dimensions)})" if variable.is_grid else name


def _about(variable: VariableDefinition) -> str:
    limits = [f"at least {variable.min}"] if variable.min is not None else []
    limits += [f"at most {variable.max}"] if variable.max is not None else []
    return variable.description + (f" ({', '.join(limits)})" if limits else "")
