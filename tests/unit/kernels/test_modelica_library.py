"""The Modelica library: its files follow the rules of a library, its models compile, run and pass their asserts."""

from __future__ import annotations

import csv
import re
import shutil
import tomllib
from collections.abc import Iterator
from datetime import date, datetime
from pathlib import Path

import numpy as np
import pymoca.ast
import pymoca.parser
import pytest
import rumoca

from support.fmus.modelica_library import (
    JMODELICA,
    LIBRARY,
    REFERENCE_MODELS,
    comparison_signals,
    compiled,
    reference_file,
    rows_of,
    simulate,
    stop_time,
)
from support.fmus.modelica_library import MODELS as RUNNING
from support.long_proofs import rest_is_long

FILES = {path: path.read_text() for path in sorted(LIBRARY.rglob("*.mo"))}
"""Every file with its text."""
FOLDERS = sorted({path.parent for path in FILES})
KINDS = (
    r"(?:package|partial package|class|partial class|model|partial model|block|partial block|record"
    r"|pure function|partial function|connector|type)"
)
EXAMPLES = rest_is_long(
    sorted((name for name in RUNNING if name.startswith("Examples.")), key=lambda name: "Cylinder" in name), 2
)
VALIDATIONS = [name for name in RUNNING if name.startswith("Validation.")]
DONE = 3  # Types.Status.done
STRING = r'"(?:[^"\\]|\\.)*"'
TYPES = r"(?:Real|Integer|Boolean|(?:\w+\.)*(?:[A-Z]\w*))"
DECLARATION = re.compile(
    rf"^  (?:replaceable )?(?:parameter |constant |discrete |input |output )*{TYPES}(?:\[[^=]*?\])? "
    rf"(?:[a-zA-Z]\w*)\b(?!\s*=\s*enumeration)",
    re.MULTILINE,
)


def qualified(path: Path) -> str:
    """The name of the class in a file."""
    parts = path.relative_to(LIBRARY.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "package" else parts)


def test_package_files_and_order_name_every_class_once() -> None:
    for folder in FOLDERS:
        present = {path.stem for path in folder.glob("*.mo")} - {"package"} | {
            inner.name for inner in folder.iterdir() if inner.is_dir() and inner.name != "Resources"
        }
        ordered = (folder / "package.order").read_text().split()
        assert sorted(ordered) == sorted(present), folder


def test_the_library_has_the_version_of_the_project_and_says_when_it_was_made() -> None:
    """In the forms of MLS 18.8.2; the version is not older than the library as it stands."""
    project = tomllib.loads((LIBRARY.parents[1] / "pyproject.toml").read_text())["project"]
    package = FILES[LIBRARY / "package.mo"]
    annotation = dict(re.findall(r"^    (version\w*|dateModified)=\"?(.*?)\"?,$", package, re.MULTILINE))
    assert annotation["version"] == project["version"]
    assert f"<h4>Version {project['version']}</h4>" in FILES[LIBRARY / "UsersGuide/ReleaseNotes.mo"]
    assert annotation["versionBuild"].isdigit()
    modified = datetime.strptime(annotation["dateModified"], "%Y-%m-%d %H:%M:%SZ")
    assert date.fromisoformat(annotation["versionDate"]) <= modified.date()


def shortcomings(path: Path, text: str) -> list[str]:
    """Missing parts of a file: the place and name of one class, a description, a documentation."""
    name = qualified(path)
    short = name.rpartition(".")[2]
    place = f"within {name.rpartition('.')[0]};\n" if "." in name else "within ;\n"
    one_line = re.search(rf"^(?:type|connector) {short} = ", text, re.MULTILINE)
    documentation = re.search(rf"Documentation\(info=({STRING})\)", text, re.DOTALL)
    is_html = documentation and documentation[1].startswith('"<html>') and documentation[1].endswith('</html>"')
    kept = {
        "place": text.startswith(place),
        "description": re.search(rf"^{KINDS} {short}\b(?: = [^;]*?)?\s*{STRING}", text, re.MULTILINE),
        "one class": len(re.findall(rf"^{KINDS} \w+", text, re.MULTILINE)) == 1,
        "end": re.search(rf"^end {short};$", text, re.MULTILINE) or one_line,
        "documentation": is_html,
    }
    return [f"{name}: {what}" for what, holds in kept.items() if not holds]


def test_a_file_holds_one_class_with_its_name_place_description_and_documentation() -> None:
    assert len(FILES) > 100
    assert not [found for path, text in FILES.items() for found in shortcomings(path, text)]


def declarations(text: str) -> list[str]:
    """The component declarations of a class, each up to its semicolon."""
    head = re.split(r"^(?:initial )?(?:equation|algorithm)$|^  annotation", text, maxsplit=1, flags=re.MULTILINE)[0]
    statements = re.findall(rf"(?:{STRING}|[^;\"])+;", head)
    return [statement for statement in statements if DECLARATION.search(statement)]


def test_every_declaration_has_a_description_and_every_real_number_a_unit() -> None:
    assert declarations('  parameter Real x(unit="m; or so") = 1;\n') == ['  parameter Real x(unit="m; or so") = 1;']
    assert len(declarations(FILES[LIBRARY / "Interfaces/PartialDeposition.mo"])) == 20
    described = re.compile(rf"{STRING}\s*(?:annotation.*)?;$", re.DOTALL)
    bare = re.compile(r"^  (?:\w+ )*Real\b(?![^\";]*unit=)", re.MULTILINE)
    assert not [
        (qualified(path), declaration)
        for path, text in FILES.items()
        for declaration in declarations(text)
        if bare.search(declaration) or not described.search(declaration)
    ]
    short = re.compile(r"^(?:type|connector) \w+ = (?:input |output )?Real\b.*", re.MULTILINE)
    assert not [found for text in FILES.values() for found in short.findall(text) if "final unit=" not in found]


def test_links_of_the_documentation_lead_to_a_class() -> None:
    known = {qualified(path) for path in FILES}
    assert not [
        (qualified(path), name)
        for path, text in FILES.items()
        for name in re.findall(r"modelica://([\w.]+)", text)
        if name not in known
    ]


def test_types_have_the_quantities_and_units_of_the_standard_library() -> None:
    """Modelica.Units.SI 4.0: Length, Area, Volume, Time and Angle, so that variables of both connect."""
    pairs = re.compile(r'final quantity="(\w+)", final unit="(\w+)"')
    found = {pair for text in FILES.values() for pair in pairs.findall(text)}
    assert found == {("Length", "m"), ("Area", "m2"), ("Volume", "m3"), ("Time", "s"), ("Angle", "rad")}


def inherited_icon(path: Path) -> str:
    """The class of Icons that a class extends."""
    found = re.search(r"^  extends (?:Icons\.)?(\w+);", FILES[path], re.MULTILINE)
    return found[1] if found else ""


def test_every_file_is_modelica() -> None:
    """For the parsers of two makers; the second raises ModelicaSyntaxError."""
    assert not [(qualified(path), found) for path in FILES for found in rumoca.validate(str(path))]
    assert not [qualified(path) for path, text in FILES.items() if pymoca.parser.parse(text) is None]


def classes_of(tree: pymoca.ast.Class) -> Iterator[pymoca.ast.Class]:
    """The classes of a parsed file, at any depth."""
    for found in tree.classes.values():
        yield found
        yield from classes_of(found)


def modified_parts(tree: pymoca.ast.Tree) -> Iterator[tuple[str, set[str]]]:
    """Components that an `extends` modifies without replacing them: name, and the names that it sets in them."""
    for each in classes_of(tree):
        for extends in each.extends:
            for argument in extends.class_modification.arguments:
                changes = [
                    change for change in getattr(argument.value, "modifications", []) if hasattr(change, "arguments")
                ]
                if changes:
                    yield (
                        argument.value.component.name,
                        {one.value.component.name for change in changes for one in change.arguments},
                    )


def test_modifiers_of_a_replaceable_part_fit_whatever_replaces_it() -> None:
    """MLS 7.3.2: what is not in the constraining class belongs to a redeclaration; strict compilers refuse the rest."""
    replaceable = re.compile(r"^  replaceable [\w.]+ (\w+)\(.*?\) constrainedby ([\w.]+)", re.MULTILINE)
    constraints = {found[1]: found[2].split(".") for text in FILES.values() for found in replaceable.finditer(text)}
    assert set(constraints) == {"controller", "deposition", "sensor"}
    trees = {path: pymoca.parser.parse(text) for path, text in FILES.items() if path.parent.name == "Examples"}
    modified = [(path, *found) for path, tree in trees.items() for found in modified_parts(tree)]
    assert len(modified) >= 4
    for path, part, names in modified:
        file = LIBRARY.joinpath(*constraints[part]).with_suffix(".mo")
        (constraint,) = (found for found in classes_of(pymoca.parser.parse(FILES[file])) if found.name == file.stem)
        assert sorted(names - set(constraint.symbols)) == [], f"{qualified(path)}.{part}"


def test_every_class_is_reached_by_a_model_that_runs() -> None:
    """A class that no example and no validation uses would never be compiled."""
    classes = {
        path.stem: re.sub(STRING, "", text.split("\n  annotation")[0])
        for path, text in FILES.items()
        if path.stem != "package" and "UsersGuide" not in path.parts
    }
    reached = {name.rpartition(".")[2] for name in RUNNING} | {
        inherited_icon(path) for path in FILES if path.stem == "package"
    }
    new = reached
    while new:
        words = {word for name in new for word in re.findall(r"\w+", classes[name])}
        new = (words & set(classes)) - reached
        reached = reached | new
    assert sorted(set(classes) - reached - {"Package"}) == []


@pytest.mark.system
@pytest.mark.parametrize("model", RUNNING)
def test_every_example_and_validation_has_as_many_equations_as_unknowns_and_no_loop(model: str) -> None:
    structure = compiled(model).structure()
    assert structure.is_balanced
    assert structure.is_matched
    assert structure.n_algebraic_loops == 0


@pytest.mark.system
@pytest.mark.long
def test_another_compiler_sorts_every_model_and_finds_no_part_misused(tmp_path: Path) -> None:
    if absent := JMODELICA.reason_it_is_absent():
        pytest.skip(absent)
    library = JMODELICA.copy_of_library(tmp_path)
    messages = {message for model in RUNNING for message in JMODELICA.compile(library, model)}
    assert messages <= {"Variable array index in equation can result in slow simulation time"}


@pytest.mark.system
@pytest.mark.parametrize("model", VALIDATIONS)
def test_every_validation_runs_to_its_end(model: str) -> None:
    assert simulate(model, stop_time(model)).end == stop_time(model)


@pytest.mark.system
@pytest.mark.parametrize("model", EXAMPLES)
def test_an_example_gives_its_reference_results_layer_after_scan(model: str) -> None:
    assert model in REFERENCE_MODELS
    signals, run = comparison_signals(model), simulate(model, stop_time(model))
    with reference_file(model).open(newline="") as file:
        heads, *reference = csv.reader(file)
    assert heads == signals
    assert signals[0] == "time"
    assert np.array(rows_of(run, signals)) == pytest.approx(np.array(reference, dtype=float), rel=1e-12, abs=0.0)
    commanded, printed, scanned = (
        run.series(name) for name in ("controller.layer_command", "deposition.layers_printed", "sensor.layers_scanned")
    )
    assert commanded[0] == printed[0] == 0
    assert scanned[0] == -1
    assert (commanded <= scanned + 1).all()
    assert (printed <= commanded).all()
    assert commanded[-1] == printed[-1] == scanned[-1] > 1


@pytest.mark.system
@pytest.mark.parametrize(
    ("file", "right", "wrong", "model", "message"),
    [
        ("Functions/saturation.mo", "1 + rise/width", "1", "CuboidFourLayers", "the middle row is not"),
        ("Functions/saturation.mo", "1 + rise/width", "1 + 0.9*rise/width", "LineOfCells", "layer 2: the edge is not"),
        ("Functions/dropletShares.mo", "(spread - taken)", "0.9*(spread - taken)", "MassBalance", "do not add up"),
        ("Functions/volumeAreaDrop.mo", "left - gained", "left - 0.9*gained", "VolumeAreaBalance", "do not add up"),
        (
            "Functions/heightDifference.mo",
            "around/max(1, touching)",
            "around/8",
            "HeightDifferences",
            r"equation \(19\)",
        ),
        ("Functions/capOverRectangle.mo", "0.75*(bound", "0.74*(bound", "CapShares", "four quarters are not"),
        ("Functions/Random/philox.mo", "1:10", "1:9", "RandomNumbers", "zeros: not"),
    ],
)
def test_a_validation_stops_when_the_model_is_wrong(file, right, wrong, model, message, tmp_path: Path) -> None:
    copy = shutil.copytree(LIBRARY, tmp_path / "InkLoop")
    text = (copy / file).read_text()
    assert text.count(right) == 1
    (copy / file).write_text(text.replace(right, wrong))
    broken = rumoca.Session().load(str(copy / "package.mo"), model=f"InkLoop.Validation.{model}")
    with pytest.raises(rumoca.SimulationError, match=message):
        broken.simulate(t=(0.0, 5.0), dt=0.5)


@pytest.mark.system
@pytest.mark.long
def test_threshold_feedback_evens_out_what_open_loop_leaves() -> None:
    """Five nozzles lack up to 40 % of their volume: 17 um too low and stripes in open loop, not so in closed loop."""
    inside = np.hypot(*np.meshgrid(np.arange(-5, 6), np.arange(-5, 6))) <= 4
    examples = {"CylinderOpenLoop": 8.0, "CylinderThresholdFeedback": 14.0}
    runs = [simulate(f"Examples.{name}", stop) for name, stop in examples.items()]
    surfaces = [run.at("deposition.height", run.end, (11, 11))[inside] for run in runs]
    assert [run.at("controller.status", run.end) for run in runs] == [DONE, DONE]
    assert [45.6e-6 - surface.mean() for surface in surfaces] == pytest.approx([17.3e-6, 2.1e-6], abs=0.1e-6)
    assert [surface.std() for surface in surfaces] == pytest.approx([2.79e-6, 1.03e-6], abs=0.02e-6)
