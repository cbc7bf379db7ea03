"""Writers of pages: marks that they fill, records that they write, scenarios that they run."""

from __future__ import annotations

from pathlib import Path

import pytest
from tools.figures import gallery, pages


def test_records_are_read_as_they_were_written(tmp_path: Path) -> None:
    pages.write_json(tmp_path / "one.json", {"µ": [1.5, None]})
    assert pages.read_json(tmp_path / "one.json") == {"µ": [1.5, None]}
    assert "µ" in (tmp_path / "one.json").read_text(encoding="utf-8")


def test_marks_of_a_page_are_filled_and_missing_ones_are_refused() -> None:
    page = "a <!-- one -->old<!-- end --> b <!-- two -->kept<!-- end -->"
    assert pages.filled(page, {"one": "new"}) == "a <!-- one -->new<!-- end --> b <!-- two -->kept<!-- end -->"
    with pytest.raises(KeyError, match="the page has no mark four, three"):
        pages.filled(page, {"three": "", "one": "", "four": ""})


def test_scenarios_of_the_gallery_are_run_by_name_and_those_that_are_gone_are_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = tmp_path / "record.json"
    for name in ("b", "a", "c"):
        (tmp_path / f"{name}.toml").write_text("")
    monkeypatch.setattr(gallery, "RECORD", record)
    monkeypatch.setattr(gallery, "SCENARIOS", tmp_path)
    monkeypatch.setattr(gallery, "draw", lambda path: f"runs of {path.name}")
    monkeypatch.setattr(gallery, "measured", lambda runs: f"figures of {runs}")
    record.write_text('{"a": "old", "gone": "old", "c": "old"}')
    gallery.run("b", "c")
    fresh = {name: f"figures of runs of {name}.toml" for name in ("b", "c")}
    assert pages.read_json(record) == {"a": "old", **fresh}
    record.unlink()
    gallery.run()
    assert list(pages.read_json(record)) == ["a", "b", "c"]
