"""The pages are correct: their Python runs, their links lead somewhere, the scenario page names every key."""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel, ValidationError

from inkloop.cli import main, parser
from inkloop.components import catalog
from inkloop.results.result import Result
from inkloop.tables import schema
from inkloop.testing import CONTRACT_CHECKS, job
from inkloop_controller.baseline_planners import OpenLoop
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.planning.horizon_planner import Finish, ending_of
from inkloop_controller.planning.layer_plan import LayerPlan, PlanStatus
from inkloop_lab.identify.log_folder import PrintTable
from inkloop_lab.sweep.study import Study
from support.page_commands import COMMANDS_BY_PAGE, PAGES
from support.places import ROOT

WHOLE_PRINTS = {"one-block-job-0", "one-block-job-1", "use-the-controller-from-python-3", "use-the-fmus-2"}
"""Blocks of pages that print for seconds."""


def python_blocks() -> Iterator[object]:
    for page in PAGES:
        for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)):
            name = f"{page.stem}-{number}"
            yield pytest.param(block, id=name, marks=[pytest.mark.long] if name in WHOLE_PRINTS else [])


@pytest.mark.system
@pytest.mark.parametrize("block", list(python_blocks()))
def test_python_of_the_pages_runs(block: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if "LayerEnv" in block:
        pytest.importorskip("gymnasium", reason="needs gymnasium: pip install 'inkloop[env]'")
    monkeypatch.chdir(ROOT)
    exec(compile(block, "page.py", "exec"), {"__name__": "__main__"})


def blocks_of_the_how_to(folder: Path) -> list[str]:
    """Writes the modules of the page on components of one's own into a folder; its TOML."""
    page = (ROOT / "docs/how-to/bring-your-own-component.md").read_text()
    for name, code in re.findall(r"```python\n# (\w+\.py)\n(.*?)```", page, re.DOTALL):
        (folder / name).write_text(code)
    return re.findall(r"```toml\n(.*?)```", page, re.DOTALL)


def cuboid_with(name: str, table: str, text: str) -> str:
    """A scenario with another table of a component."""
    ours = re.search(rf"\[components\.{name}\]\n(?:\S.*\n)+", text)
    assert ours is not None
    return text.replace(ours[0], table)


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.system
@pytest.mark.parametrize("kind", ["threshold:Threshold", "threshold_by_hand:Threshold"])
def test_controllers_of_the_how_to_print_the_cuboid(kind: str, tmp_path: Path) -> None:
    table, *_ = blocks_of_the_how_to(tmp_path)
    cuboid = (ROOT / "scenarios/cuboid.toml").read_text()
    (tmp_path / "mine.toml").write_text(cuboid_with("controller", table.replace("threshold:Threshold", kind), cuboid))
    assert main(["run", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "run"), "--no-compare"]) == 0
    metrics = Result.load(tmp_path / "run").metrics()
    assert metrics["layers"] >= 3
    assert abs(metrics["mean_error"]) < 3e-6


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.system
def test_plant_of_the_how_to_prints_the_cuboid_to_the_droplet(tmp_path: Path) -> None:
    controller, printer, *_ = blocks_of_the_how_to(tmp_path)
    cuboid = (ROOT / "scenarios/cuboid.toml").read_text()
    (tmp_path / "mine.toml").write_text(cuboid_with("printer", printer, cuboid_with("controller", controller, cuboid)))
    assert main(["run", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "run"), "--no-compare"]) == 0
    metrics = Result.load(tmp_path / "run").metrics()
    assert metrics["layers"] == 3
    assert metrics["std"] < 1e-12
    assert metrics["mean_error"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.system
def test_checks_of_the_how_to_run_as_described(tmp_path: Path) -> None:
    blocks_of_the_how_to(tmp_path)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_columns.py"]
    run = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout
    assert f"{len(CONTRACT_CHECKS)} passed" in run.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_a_file(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
    missing = [target for target in targets if not (page.parent / target).exists()]
    assert not missing


def test_commands_of_the_pages_have_known_options_and_files(capsys: pytest.CaptureFixture[str]) -> None:
    whole = parser()
    refused = []
    commands = [(page, line) for page, lines in COMMANDS_BY_PAGE.items() for line in lines]
    for page, line in commands:
        words = shlex.split(line, comments=True)
        try:
            whole.parse_args(words)
        except SystemExit:
            refused.append(f"{page}: {line}: {capsys.readouterr().err}")
        refused += [f"{page}: {word}" for word in words if word.startswith("scenarios/") and not (ROOT / word).exists()]
    assert len(commands) > 60
    assert not refused


TOML = re.compile(r"```toml\n(.*?)```", re.DOTALL)


def toml_blocks(*pages: str) -> Iterator[object]:
    for page in pages:
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        for number, block in enumerate(TOML.findall(text)):
            yield pytest.param(block, id=f"{Path(page).stem}-{number}")


PARTS = (
    "how-to/bring-your-own-component.md",
    "how-to/height-maps-from-files.md",
    "how-to/plant-in-another-program.md",
    "how-to/solve-a-layer-with-casadi.md",
    "reference/bench-faults.md",
    "reference/peers.md",
    "reference/scenario.md",
)


@pytest.mark.parametrize("block", list(toml_blocks(*PARTS, "tutorial/your-own-plant.md")))
def test_toml_of_the_pages_has_known_keys_and_valid_values(block: str) -> None:
    """A block may be part of a scenario: keys may be missing, nothing else may be wrong."""
    errors: list[object] = []
    try:
        schema.ScenarioFile.model_validate(tomllib.loads(block))
    except ValidationError as error:
        errors = [each for each in error.errors() if each["type"] != "missing"]
    assert not errors


def test_toml_of_an_identification_has_known_keys_and_valid_values() -> None:
    log, ink = TOML.findall((ROOT / "docs/how-to/identify-an-ink.md").read_text(encoding="utf-8"))
    PrintTable.model_validate(tomllib.loads(log))
    assert set(tomllib.loads(ink)["ink"]) <= set(schema.ScenarioFile.model_fields["ink"].annotation.model_fields)


def test_toml_of_every_page_is_in_one_of_these_tests() -> None:
    checked = {*PARTS, "tutorial/your-own-plant.md", "how-to/identify-an-ink.md", "how-to/sweep-settings.md"}
    checked.add("how-to/bind-your-own-dbc.md")  # the mapping that the tests of mapped rigs print with
    assert {page.relative_to(ROOT / "docs").as_posix() for page in PAGES if TOML.search(page.read_text())} == checked


@pytest.mark.parametrize("block", list(toml_blocks("how-to/sweep-settings.md")))
def test_studies_of_the_how_to_are_valid(block: str, tmp_path: Path) -> None:
    scenario = f'scenario = "{(ROOT / "scenarios/cuboid.toml").as_posix()}"\n'
    rest = re.sub(r"^scenario = .*\n", "", block)
    varied = "" if "[vary]" in block or "[sample]" in block else "[vary]\nlabel = ['a', 'b']\n"
    (tmp_path / "study.toml").write_text(scenario + rest + varied)
    assert Study.load(tmp_path / "study.toml").count > 1


def test_scenario_page_names_every_key_and_kind() -> None:
    page = (ROOT / "docs/reference/scenario.md").read_text()
    tables = [table for table in vars(schema).values() if isinstance(table, type) and issubclass(table, BaseModel)]
    inner = {"components", "connections", "compare", "literature", "grid", "part", "substrate", "support", "ink"}
    inner |= {"process", "run", "metrology", "bench", "buses"}
    keys = {key for table in tables for key in table.model_fields} - inner - {"a", "b"}
    assert not sorted(key for key in keys | set(catalog.kinds()) if f"`{key}`" not in page)


def test_every_option_of_the_controllers_is_on_the_scenario_page() -> None:
    page = (ROOT / "docs/reference/scenario.md").read_text()
    for name, python in catalog.PYTHON_KINDS.items():
        parameters = inspect.signature(python.entry.load()).parameters.values()
        options = [parameter.name for parameter in parameters if parameter.kind is parameter.KEYWORD_ONLY]
        assert options
        assert not [option for option in options if f"`{option}`" not in page], name


def test_endings_have_the_same_meaning_on_the_page_and_in_the_definition() -> None:
    page = (ROOT / "docs/explanation/the-layer-problem.md").read_text()
    definition = (ROOT / "fmus/layer_controller/variables.toml").read_text()
    for finish in get_args(Finish):
        ending = ending_of(finish)
        row = rf"\| `\"{finish}\"`(?: \(default\))? \| {ending.horizon} \| {ending.layer_worth:g} \|"
        assert re.search(row, page)
        assert re.search(rf'"{finish}" plans {ending.horizon} .*?gain {ending.layer_worth:g}\b', definition)


def test_plan_page_names_every_field_status_and_output() -> None:
    page = (ROOT / "docs/reference/layer-plan.md").read_text()
    part = job()
    outputs = [port.name for port in LayerController(part, OpenLoop(part), HeightEstimator(part)).outputs]
    fields = [field.name for field in dataclasses.fields(LayerPlan)]
    assert not [name for name in (*outputs, *fields, "gap") if f"`{name}`" not in page]
    assert not [word for number, word in enumerate(PlanStatus) if f"| `{word}` | {number} |" not in page]
