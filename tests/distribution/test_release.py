"""A release states the same version, licence and sources everywhere."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from inkloop import __version__
from inkloop.fmu import describe
from inkloop.fmu_writer.export import find_fmu
from support.places import ROOT

FILE = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = FILE["project"]
CITATION = (ROOT / "CITATION.cff").read_text("utf-8")


def cited(key: str) -> list[str]:
    """Values of a key of CITATION.cff, at any depth."""
    return re.findall(rf"^ *(?:- )?{key}: (.+)$", CITATION, re.MULTILINE)


@pytest.mark.parametrize("form", ["fmi2", "fmi3", "fmi3-fixed"])
@pytest.mark.parametrize("model", ["LayerDeposition", "ProfileSensor"])
def test_fmu_is_of_the_version_and_licence_of_the_project(model: str, form: str) -> None:
    description = describe(find_fmu(model, form))
    assert (description.version, description.license) == (PROJECT["version"], PROJECT["license"])


def test_version_is_written_once_for_the_build() -> None:
    assert PROJECT["version"] == __version__
    assert "VERSION ${SKBUILD_PROJECT_VERSION}" in (ROOT / "CMakeLists.txt").read_text("utf-8")


def test_citation_is_plain_yaml_of_the_project_and_names_the_papers() -> None:
    top = {line.partition(":")[0] for line in CITATION.splitlines() if re.match(r"[a-z]", line)}
    assert top >= {"cff-version", "message", "title", "authors"}
    assert all(re.fullmatch(r" *(- )?([a-z-]+:( [^:#]+)?|[^:#]+)", line) for line in CITATION.splitlines())
    assert (cited("version"), cited("license")) == ([PROJECT["version"]], [PROJECT["license"]])
    assert cited("title")[0] == PROJECT["name"]
    references = CITATION.partition("references:")[2].split("- type: article")[1:]
    families = [re.findall(r"family-names: (\w+)", reference) for reference in references]
    assert families == [["Lu", "Zheng", "Mishra"], ["Hume", "Rosen"], ["Wu", "Chiu"]]
    assert [re.findall(r"year: (\d{4})", reference) for reference in references] == [["2015"], ["2018"], ["2024"]]


def constraints() -> dict[str, str]:
    """Version of each package in constraints.txt, by its normalised name."""
    lines = [line for line in (ROOT / "constraints.txt").read_text("utf-8").splitlines() if not line.startswith("#")]
    return {canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines)}


def requirements() -> list[Requirement]:
    """Requirements of a build, a print and the tests, without the extras of the project itself."""
    extras = [text for extra in PROJECT["optional-dependencies"].values() for text in extra]
    found = [Requirement(text) for text in (*FILE["build-system"]["requires"], *PROJECT["dependencies"], *extras)]
    return [requirement for requirement in found if requirement.name != PROJECT["name"]]


def test_constraints_have_a_version_that_every_requirement_allows() -> None:
    versions = constraints()
    assert all(re.fullmatch(r"\d[\w.]*", version) for version in versions.values())
    assert len(requirements()) > 30
    for requirement in requirements():
        version = versions.get(canonicalize_name(requirement.name), "")
        assert version, requirement
        assert requirement.specifier.contains(version), requirement


def test_workflows_run_every_python_that_the_project_names() -> None:
    named = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert PROJECT["requires-python"] == f">={named[0]}"
    workflows = sorted((ROOT / ".github/workflows").glob("*.yml"))
    assert [path.stem for path in workflows] == ["check", "test", "wheels"]
    for path in workflows:
        (matrix,) = re.findall(r"python: \[(.+)\]", path.read_text("utf-8"))
        assert re.findall(r"[\d.]+", matrix) == named, path.name


def test_changelog_begins_with_the_present_version_and_dates_every_closed_one() -> None:
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased" or headings[0].startswith(PROJECT["version"])
    closed = [heading for heading in headings if heading != "Unreleased"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ - \d{4}-\d{2}-\d{2}", heading) for heading in closed)
