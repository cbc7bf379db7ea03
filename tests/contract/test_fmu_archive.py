"""Content of the FMUs: valid descriptions, honest flags, only the standard's symbols, sources that compile."""

from __future__ import annotations

import re
import shutil
import zipfile
from math import pi
from pathlib import Path

import fmpy
import pytest
from fmpy.build import build_platform_binary
from lxml import etree

from inkloop.component import Status
from inkloop.fmu.reading import describe
from inkloop.fmu_writer import definition
from inkloop.fmu_writer.archive import read_definition, unpack
from inkloop.fmu_writer.export import export_fmu, find_fmu
from inkloop.results.attributes import LEFT_OUT, MEANINGS
from support.fmus.fmu_checkers import by_fmpy
from support.fmus.fmu_driver import DEPOSITION_MODELS, FORMS, MODELS, Driver, random_patterns
from support.fmus.fmu_library import HEADERS, described
from support.fmus.fmu_life import EVERY_MODEL
from support.fmus.library_symbols import assert_of_the_standard
from support.long_proofs import rest_is_long
from support.places import ROOT
from support.source_tree import c_files

EVERY_FORM = pytest.mark.parametrize("form", FORMS)
NOMINALS = {"1/m": 1e4, "m": 1e-6, "m3": 1e-15}
SHORT = ("LayerDeposition", "fmi2")
COMPILED = [SHORT, *((m, form) for m in MODELS for form in ("fmi3", "fmi2") if (m, form) != SHORT)]
"""FMUs compiled again; the sources of the others are those of the build (below)."""


@EVERY_FORM
@EVERY_MODEL
@pytest.mark.parametrize(("nx", "ny"), rest_is_long([(3, 2), (7, 4), (1, 1), (1, 12)], 1))
def test_descriptions_are_valid(model, form, nx, ny, tmp_path) -> None:
    path = export_fmu(model, fmi=form[3], nx=nx, ny=ny, fixed=form != "fmi3", out=tmp_path / "it.fmu")
    assert by_fmpy(path) == []


@pytest.mark.system
@pytest.mark.parametrize("form", rest_is_long(("fmi3", "fmi3-fixed", "fmi2"), 2))
@EVERY_MODEL
def test_descriptions_of_the_built_set_are_valid(model, form) -> None:
    """FMI 2 repeats itself for each of its cells; another checker reads it with the tests of other masters."""
    assert by_fmpy(find_fmu(model, form)) == []


@EVERY_FORM
def test_illegal_name_is_an_error_in_every_description_that_has_it(form, tmp_path) -> None:
    """FMPy's own check of names, which the checks above share among the descriptions."""
    for number in range(2):
        path = export_fmu(
            "ProfileSensor", fmi=form[3], nx=3, ny=2, fixed=form != "fmi3", out=tmp_path / f"{number}.fmu"
        )
        folder = Path(fmpy.extract(str(path), str(tmp_path / str(number))))
        description = folder / "modelDescription.xml"
        description.write_text(description.read_text().replace('name="seed"', 'name="seed of noise"'))
        (error,) = by_fmpy(folder)
        assert '"seed of noise"' in error
        assert "is not a legal variable name" in error


@EVERY_FORM
@EVERY_MODEL
def test_archive_holds_what_people_and_tools_look_for(model, form) -> None:
    with zipfile.ZipFile(find_fmu(model, form)) as archive:
        names = set(archive.namelist())
        index = archive.read("documentation/index.html").decode()
        assert "Redistribution" in archive.read("documentation/licenses/license.txt").decode()
        icon = archive.read("model.png" if form == "fmi2" else "terminalsAndIcons/icon.png")
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    platform = fmpy.platform if form == "fmi2" else fmpy.platform_tuple
    assert f"binaries/{platform}/{model}{fmpy.sharedLibraryExtension}" in names
    assert icon.startswith(b"\x89PNG")
    assert "documentation/diagram.png" in names
    assert 'src="diagram.png"' in index
    for variable in ("seed", "layers_printed", "nx"):
        assert f"<td>{variable}</td>" in index


@EVERY_FORM
@EVERY_MODEL
def test_flags_are_those_that_other_tests_show(model, form) -> None:
    """Variable steps and states: see the handshake and state tests."""
    root = described(find_fmu(model, form))
    interface = root.find("CoSimulation")
    word = "state" if form == "fmi2" else "State"
    flags = ("canHandleVariableCommunicationStepSize", f"canGetAndSetFMU{word}", f"canSerializeFMU{word}")
    assert [interface.get(flag) for flag in flags] == ["true"] * 3
    assert interface.get("hasEventMode", "false") == "false"
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", root.get("generationDateAndTime", ""))
    assert root.get("license") == "BSD-3-Clause"
    assert float(root.find("DefaultExperiment").get("stepSize")) > 0.0  # type: ignore[arg-type]


@EVERY_FORM
def test_date_follows_the_source_date(form, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    paths = [
        export_fmu("ProfileSensor", fmi=form[3], nx=3, ny=2, fixed=form != "fmi3", out=tmp_path / f"{k}.fmu")
        for k in range(2)
    ]
    assert described(paths[0]).get("generationDateAndTime") == "1970-01-02T00:00:00Z"
    assert paths[0].read_bytes() == paths[1].read_bytes()


@EVERY_FORM
@EVERY_MODEL
def test_variables_have_descriptions_units_and_display_units(model, form) -> None:
    """FMI: display value = factor * value in the unit."""
    root, factors = described(find_fmu(model, form)), {"um": 1e6, "1/um": 1e-6, "um3": 1e18, "deg": 180 / pi, "ms": 1e3}
    units = {unit.get("name") for unit in root.find("UnitDefinitions")}
    assert all(variable.get("description") for variable in root.find("ModelVariables"))
    reals = [element for element in root.find("ModelVariables").iter() if element.get("unit")]
    assert len(reals) > 5
    assert all(float(element.get("nominal", "1")) == NOMINALS.get(element.get("unit", ""), 1.0) for element in reals)
    assert all(element.get("unit") in units and element.get("displayUnit") for element in reals)
    for unit in root.iterfind("UnitDefinitions/*/DisplayUnit"):
        assert float(unit.get("factor", "1")) == pytest.approx(factors[unit.get("name", "")], rel=1e-12, abs=0.0)


@EVERY_FORM
@EVERY_MODEL
def test_status_has_the_words_of_the_layer_contract(model, form) -> None:
    items = describe(find_fmu(model, form)).variables["status"].items
    assert items == {status.name.lower(): status for status in Status}
    if form != "fmi2":  # FMPy 0.3.20 reads no type with a description
        assert all(set(t.attrib) == {"name"} for t in described(find_fmu(model, form)).find("TypeDefinitions"))


def test_codes_of_the_controller_have_the_words_of_results() -> None:
    model = read_definition(find_fmu("LayerController"))
    for name, output in (("PlanStatus", "plan_status"), ("Transform", "stop_transform")):
        items = {number: word for word, number in model.types[name].items.items() if number}
        assert items == {number: MEANINGS[output].flags[number] for number in items}
    reasons = {word: 1 << bit for bit, word in enumerate(MEANINGS["untrusted_reasons"].masks)}
    stops = {word: number for word, number in reasons.items() if number >= 64}
    assert model.types["StopReason"].items == {"none": 0, **stops}
    about = {v.name: v.description for v in model.exposed}
    assert all(f"{number} {word}" in about["untrusted_reasons"] for word, number in reasons.items())
    assert all(f"{1 << bit} {word}" in about["left_out"] for bit, word in enumerate(LEFT_OUT[:4]))
    job = {v.name: v for v in definition.load((ROOT / "fmus/layer_job/variables.toml").read_text(), "").exposed}
    assert all(f"{number} {word}" in job["untrusted_reasons"].description for word, number in reasons.items())


@EVERY_MODEL
def test_same_variables_in_every_form(model) -> None:
    found = []
    for form in FORMS:
        variables = fmpy.read_model_description(str(find_fmu(model, form))).modelVariables
        found.append(list(dict.fromkeys(v.name.partition("[")[0] for v in variables)))
    assert found[0] == found[1] == ["time", *found[2]]  # FMI 2 does not list it


@EVERY_FORM
@EVERY_MODEL
def test_binary_has_the_standards_functions_and_needs_the_c_library(model, form) -> None:
    members = unpack(find_fmu(model, form))
    (binary,) = (content for name, content in members.items() if name.startswith("binaries/"))
    assert_of_the_standard(binary, form[3])


@EVERY_FORM
@EVERY_MODEL
def test_sources_are_those_of_the_project(model, form) -> None:
    """Byte for byte, but for the table of the variables and the name of the model, which are generated."""
    ours = {path.name: path.read_bytes() for path in c_files()}
    with zipfile.ZipFile(find_fmu(model, form)) as archive:
        sources = {Path(name).name: archive.read(name) for name in archive.namelist() if re.search(r"\.[ch]$", name)}
    assert len(sources) > 10
    assert [name for name, content in sources.items() if name in ours and content != ours[name]] == []
    generated = r"\w+_(values\.h|variables\.[ch])|fmu_model\.c"
    assert all(re.fullmatch(generated, name) for name in sources.keys() - ours.keys())


@pytest.mark.compiled
@pytest.mark.parametrize(("model", "form"), rest_is_long(COMPILED, 1))
@pytest.mark.skipif(shutil.which("cmake") is None or shutil.which("gcc") is None, reason="needs cmake and gcc")
def test_sources_compile_to_the_same_bits(model, form, tmp_path) -> None:
    fmpy.extract(str(find_fmu(model, form)), str(tmp_path))
    shutil.rmtree(tmp_path / "binaries")
    build_platform_binary(tmp_path, all_warnings=True)
    random = {
        "LayerDeposition": {"variation": 0.3, "passes": 4},
        "SuperpositionDeposition": {"variation": 0.3},
        "VolumeAreaDeposition": {"variation": 0.3, "passes": 4},
        "YoungLaplaceDeposition": {"variation": 0.3, "cells_per_pitch": 4},
        "ProfileSensor": {"noise_std": 1e-6, "spot_radius": 3e-4},
        "LayerController": {"layers_scanned": 0},
    }
    states = []
    for folder in (None, tmp_path):
        with Driver(model, form, folder=folder).start(random[model]) as fmu:  # type: ignore[arg-type]
            if model in DEPOSITION_MODELS:
                for pattern in random_patterns(9, 9, 3):
                    fmu.print_layer(pattern)
            else:
                fmu.step(0.0, 10.0)
            states.append(fmu.save())
    assert states[0] == states[1]


@pytest.mark.parametrize("form", ["fmi3", "fmi3-fixed"])
@EVERY_MODEL
def test_terminals_group_the_signals_of_the_contract(model, form) -> None:
    schema = etree.XMLSchema(file=str(HEADERS.parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"))
    with zipfile.ZipFile(find_fmu(model, form)) as archive:
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    schema.assertValid(root)
    members = {t.get("name"): {m.get("memberName") for m in t} for t in root.iter("Terminal")}
    surface, command = {"height", "layers_printed"}, {"pattern", "layer_command"}
    scan = {"measured_height", "valid", "layers_scanned"}
    wanted = {
        "ProfileSensor": {"surface": surface, "scan": scan},
        "LayerController": {"surface": {"layers_printed"}, "scan": scan, "command": command},
        **{deposition: {"surface": surface, "command": command} for deposition in DEPOSITION_MODELS},
    }[model]
    assert all(signals <= members[name] for name, signals in wanted.items())


@EVERY_FORM
def test_binary_refuses_the_description_of_another_model(form, tmp_path) -> None:
    fmpy.extract(str(find_fmu("LayerDeposition", form)), str(tmp_path))
    description = tmp_path / "modelDescription.xml"
    description.write_text(description.read_text().replace("LayerDeposition-", "LayerDeposition-0"))
    with pytest.raises(Exception, match="instantiate"):
        fmpy.simulate_fmu(str(tmp_path), stop_time=1.0)
