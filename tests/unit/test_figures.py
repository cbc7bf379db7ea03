"""Tables and figures between marks of pages are those of the records and of the code."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks import RECORDED
from PIL import Image
from tools.figures import can_protocol, command_line, diagrams, gallery, house, lying_scans, performance, the_papers
from tools.figures.pages import ALONE, SITE, WRITERS, filled, marks, read_json, table, writer

from inkloop.fmu_writer import definition
from support.lying_scans.rig import Outcome
from support.places import ROOT, SCENARIOS

PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]


@pytest.mark.parametrize("name", [*WRITERS, *ALONE])
def test_page_has_what_the_record_and_the_code_give(name: str) -> None:
    for path, texts in writer(name).texts().items():
        page = path.read_text(encoding="utf-8")
        assert filled(page, texts) == page, f"run: make figures NAMES='--written {name}', or without --written"


def test_every_table_of_the_page_on_speed_is_measured_again_by_the_command_beside_it() -> None:
    """`python -m benchmarks NAME`, for every part of the record; and no part is missing."""
    record = read_json(performance.RECORD)
    assert {each["benchmark"] for each in record["tables"]} == set(RECORDED)


def test_every_mark_of_a_page_has_one_writer() -> None:
    written = [
        (path, mark) for name in (*WRITERS, *ALONE, *SITE) for path, own in writer(name).texts().items() for mark in own
    ]
    found = [(path, mark) for path in PAGES for mark in marks(path.read_text(encoding="utf-8"))]
    assert sorted(found) == sorted(written)


def test_page_that_is_written_as_a_whole_begins_with_the_words_of_its_writer() -> None:
    """Else the next run overwrites what was edited in the page."""
    page = (ROOT / "docs/reference/score-board.md").read_text(encoding="utf-8")
    assert page.startswith(the_papers.SCORE_PAGE)


def test_page_of_the_papers_says_how_many_figures_its_files_have() -> None:
    page = (ROOT / "docs/reference/the-papers.md").read_text(encoding="utf-8")
    for paper in the_papers.PAPERS:
        assert f"All {len(the_papers.rows_of(paper))} figures: [{paper}.csv](papers/{paper}.csv)" in page


def test_table_of_a_paper_becomes_a_spreadsheet() -> None:
    page = "# A paper\n\n| where | ours |\n|---|---:|\n| Fig. 1: a, b | - |\n\n- Fig. 1: a remark\n"
    assert the_papers.spreadsheet(page) == 'where,ours\n"Fig. 1: a, b",-\n'


def test_page_of_the_score_board_leaves_out_the_inks() -> None:
    inks = "Ink assumed by each controller, h1, h2, h3 in µm:\n\n| controller | lu |\n|---|---|\n| ours | 4.40 |\n"
    assert the_papers.without_inks(f"## v1\n\n{inks}\n## v2\n\n| a |\n\n{inks}") == "## v1\n\n## v2\n\n| a |\n"


def test_site_names_every_command_with_its_arguments() -> None:
    ((page, texts),) = command_line.texts().items()
    shown = filled(page.read_text(encoding="utf-8"), texts)
    assert re.search(r"^## inkloop bench emulate$", shown, re.MULTILINE)
    assert shown.count("- `--set KEY=VALUE`: override a key") > 1


def test_comments_of_frames_that_differ_by_their_node_are_one() -> None:
    assert can_protocol._shared(["State of the stage; and more", "State of the head; and more"]) == (
        "State of the node; and more"
    )
    assert can_protocol._shared(["Sender", "Sender"]) == "Sender"


def test_altered_figure_is_put_right_and_the_rest_is_kept() -> None:
    page = "It ends <!-- height -->3.1<!-- end --> um low.\n\n<!-- rows -->\n| a |\n<!-- end -->\n"
    assert marks(page) == ["height", "rows"]
    assert filled(page.replace("3.1", "3.2"), {"height": "3.1"}) == page
    with pytest.raises(KeyError, match="width"):
        filled(page, {"width": "2"})


def test_columns_of_numbers_are_aligned_to_the_right() -> None:
    assert table(("run", "std"), [("ours", "0.4"), ("theirs", "-")]) == (
        "\n| run | std |\n|---|---:|\n| ours | 0.4 |\n| theirs | - |\n"
    )


def test_record_of_the_gallery_holds_every_scenario() -> None:
    record = read_json(gallery.RECORD)
    assert sorted(record) == sorted(path.stem for path in SCENARIOS.glob("*.toml"))
    assert all((gallery.HERE / f"{name}.png").exists() for name in record)
    assert {each["seed"] for each in record.values()} == {1}  # which the page says


def test_closed_loops_of_the_gallery_end_in_time() -> None:
    """A search that gives up early puts the end of a print off, layer by layer, and all else looks well."""
    for name, each in read_json(gallery.RECORD).items():
        open_loop = each["runs"].get("open loop", {"layers": 53})["layers"]
        late = [run for run, found in each["runs"].items() if found["layers"] > 3 * open_loop + 10]
        assert not late, f"{name}: {late}"


def test_circle_of_rooms_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(house, "rooms", lambda: {"cellar": set(), "hall": {"stairs", "cellar"}, "stairs": {"hall"}})
    with pytest.raises(ValueError, match="in a circle: hall and stairs; move what they share to a room below"):
        house.storeys()


def test_prints_of_lying_scans_are_kept_as_they_ended(tmp_path: Path) -> None:
    ends = (("done", None, ""), ("stopped", 3, "3"))
    lying_scans.keep(
        [Outcome("a", 2, np.zeros((1, 1)), 0.29, 4.5, -3.25, 7, ending, at, 0, {}) for ending, at, _ in ends],
        tmp_path / "prints.csv",
    )
    figures = {"mae": "0.29", "highest": "4.5", "lowest": "-3.25", "layers": "7"}
    expected = [{"case": "a", "seed": "2", **figures, "ending": ending, "untrusted_from": at} for ending, _, at in ends]
    assert lying_scans.kept(tmp_path / "prints.csv") == {"a": expected}


@pytest.mark.parametrize("path", diagrams.DEFINITIONS, ids=lambda path: path.parent.name)
def test_diagram_of_an_fmu_has_the_ports_of_its_definition(path: Path) -> None:
    model = definition.load(definition.text_of(path), path)
    with Image.open(path.with_name("diagram.png")) as picture:
        assert picture.info["Description"] == diagrams.text(model)
    assert path.with_name("diagram.png").stat().st_size < 32_000
