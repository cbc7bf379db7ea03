"""Tables and figures of the pages are those of the records and of the code, and comments of scenarios quote them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.names import NAMES, RECORDED
from tools.figures import cylinder_prints, gallery, house, performance, run_figures, scenario_quotes, the_papers
from tools.figures.pages import filled, marks, read_json, table
from tools.figures.writers import ALONE, WRITERS, writer

from support.places import ROOT, SCENARIOS

PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]
COMMENTS = scenario_quotes.comments()


@pytest.mark.parametrize("name", [*WRITERS, *ALONE])
def test_page_has_what_the_record_and_the_code_give(name: str) -> None:
    for path, texts in writer(name).texts().items():
        page = path.read_text(encoding="utf-8")
        assert filled(page, texts) == page, f"run: make figures NAMES='--written {name}', or without --written"


def test_every_table_of_the_page_on_speed_is_measured_again_by_the_command_beside_it() -> None:
    """`python -m benchmarks NAME`, for every part of the record; and no part is missing."""
    record = read_json(performance.RECORD)
    assert set(RECORDED) <= set(NAMES)
    assert {each["benchmark"] for each in record["tables"]} == set(RECORDED)


def test_every_mark_of_a_page_has_one_writer() -> None:
    written = [
        (path, mark) for name in (*WRITERS, *ALONE) for path, own in writer(name).texts().items() for mark in own
    ]
    found = [(path, mark) for path in PAGES for mark in marks(path.read_text(encoding="utf-8"))]
    assert sorted(found) == sorted(written)


@pytest.mark.parametrize(
    ("page", "words"), [("score-board.md", the_papers.SCORE_PAGE), ("the-papers.md", the_papers.PAPERS_PAGE)]
)
def test_page_that_is_written_as_a_whole_begins_with_the_words_of_its_writer(page: str, words: str) -> None:
    """Else the next run overwrites what was edited in the page."""
    assert (ROOT / "docs/reference" / page).read_text(encoding="utf-8").startswith(words)


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


def test_record_of_the_cylinder_holds_every_print_of_the_tables() -> None:
    record = [(each.case, each.variation, each.seed) for each in cylinder_prints.record()]
    assert record == list(cylinder_prints.planned())


def test_record_of_the_gallery_holds_every_scenario_and_quoted_figure() -> None:
    record = read_json(gallery.RECORD)
    assert sorted(record) == sorted(path.stem for path in SCENARIOS.glob("*.toml"))
    for name, each in record.items():
        assert list(each["quoted"]) == list(scenario_quotes.QUOTES.get(name, {})), f"make figures NAMES=gallery/{name}"
        assert (gallery.HERE / f"{name}.png").exists()


def test_closed_loops_of_the_gallery_end_in_time() -> None:
    """A search that gives up early puts the end of a print off, layer by layer, and all else looks well."""
    for name, each in read_json(gallery.RECORD).items():
        open_loop = each["runs"].get("open loop", {"layers": 53})["layers"]
        late = [run for run, found in each["runs"].items() if found["layers"] > 3 * open_loop + 10]
        assert not late, f"{name}: {late}"


@pytest.mark.parametrize("name", COMMENTS)
def test_comment_of_a_scenario_quotes_the_figures_of_its_runs(name: str) -> None:
    assert not scenario_quotes.errors(COMMENTS[name], read_json(gallery.RECORD)[name]["quoted"])


def test_altered_or_new_figure_of_a_comment_is_found() -> None:
    comment, record = "Open loop it ends 45 µm low after 53 layers.", {"45 µm low": [44.85], "53 layers": [53.0]}
    assert not scenario_quotes.errors(comment, record)
    assert scenario_quotes.errors(comment, {"45 µm low": [44.3], "53 layers": [53.0]})
    assert scenario_quotes.errors(comment, {"45 µm low": [44.85]})
    assert scenario_quotes.errors(comment.replace("45", "46"), record)


def test_circle_of_rooms_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(house, "rooms", lambda: {"cellar": set(), "hall": {"stairs", "cellar"}, "stairs": {"hall"}})
    with pytest.raises(ValueError, match="in a circle: hall and stairs; move what they share to a room below"):
        house.storeys()


def test_dead_nozzle_is_found_so_many_layers_after_its_end() -> None:
    """It fails with layer 4; layer 6 is the first whose scan shows it."""
    run: Any = SimpleNamespace(
        scenario_text="[[events]]\nat_layer = 4\n",
        dataset=SimpleNamespace(dead_cells=SimpleNamespace(values=np.array([0, 0, 0, 0, 0, 0, 9, 9]))),
    )
    assert run_figures.found_after({"this run": run}) == 2.0


def test_groove_is_how_far_the_lines_of_dead_nozzles_lie_below_the_others_after_a_layer() -> None:
    """The lines of nozzles 5 and 12 of 16 end 7 um low in layer 1, and 4 um in the one after it."""
    height = np.full((3, 4, 20), 30e-6)
    for layer, depth in ((1, 7e-6), (2, 4e-6)):
        height[layer][:, (5, 12)] -= depth
    part = np.ones((4, 20), np.bool_)
    part[:, 0], height[:, :, 0] = False, 1.0
    run: Any = SimpleNamespace(
        dataset=SimpleNamespace(
            sizes={"y": 20}, mask=SimpleNamespace(values=part), height=SimpleNamespace(values=height)
        )
    )
    for layer, depth in ((1, 7.0), (-1, 4.0)):
        assert run_figures.groove("", layer)({"this run": run}) == pytest.approx(depth, rel=1e-9, abs=0.0)
