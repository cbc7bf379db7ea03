"""Notebooks of the documentation: what they show is what they give."""

from __future__ import annotations

import re

import pytest

from support.places import ROOT

pytest.importorskip("nbclient", reason="needs nbclient: pip install 'inkloop[test]'")
pytest.importorskip("gymnasium", reason="needs gymnasium: pip install 'inkloop[env]'")
notebooks = pytest.importorskip("tools.notebooks")
BYTES_MAX = 120_000


@pytest.mark.parametrize("name", notebooks.NOTEBOOKS)
def test_notebook_is_stored_small_as_it_ran_from_the_first_cell_on(name: str) -> None:
    assert (notebooks.FOLDER / f"{name}.ipynb").stat().st_size < BYTES_MAX
    notebook = notebooks.read(name)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not [output for cell in code for output in cell.outputs if output.output_type == "error"]
    assert not [output for cell in code for output in cell.outputs if output.get("name") == "stderr"]
    assert str(ROOT) not in notebooks.FOLDER.joinpath(f"{name}.ipynb").read_text(encoding="utf-8")


def test_policy_of_the_notebook_has_the_weights_that_it_learnt() -> None:
    source = (notebooks.FOLDER / "local_policy.py").read_text(encoding="utf-8")
    [stored] = re.findall(r"^LEARNT = (\(.*\))$", source, re.MULTILINE)
    assert stored in [text.strip() for _, text in notebooks.texts(notebooks.read("learn-a-policy"))]


@pytest.mark.long
@pytest.mark.parametrize("name", notebooks.NOTEBOOKS)
def test_notebook_runs_and_prints_what_is_stored(name: str) -> None:
    stored = notebooks.read(name)
    assert list(notebooks.texts(notebooks.executed(notebooks.read(name)))) == list(notebooks.texts(stored))
