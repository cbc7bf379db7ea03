"""Sentences break between words; what is to be copied stays whole."""

from __future__ import annotations

import pytest

from inkloop.cli import main
from inkloop.report import wrapped

ERROR = "cube.toml: 1 error\n  - part reaches beyond the grid; continue with `inkloop resume runs/my run` after it"


@pytest.mark.parametrize("columns", [30, 60, 80])
def test_words_and_quoted_commands_stay_whole(columns: int) -> None:
    lines = wrapped(ERROR, columns).split("\n")
    assert " ".join(" ".join(lines).split()) == " ".join(ERROR.split())
    assert any("`inkloop resume runs/my run`" in line for line in lines)
    assert max(len(line) for line in lines) <= columns or columns == 30


def test_lines_of_an_item_begin_below_its_text() -> None:
    assert wrapped(ERROR, 40).split("\n")[1:3] == ["  - part reaches beyond the grid;", "    continue with"]


def test_text_that_fits_stays_as_it_is() -> None:
    text = 'add to the scenario\n    [bench]\n    interface  =  "slcan"\n'
    assert wrapped(text, 40) == text


def test_error_is_wrapped_in_a_window_and_one_line_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "50")
    for is_window in (True, False):
        monkeypatch.setattr("sys.stderr.isatty", lambda is_window=is_window: is_window)
        assert main(["report", "a-folder-that-is-not-there"]) == 1
        lines = capsys.readouterr().err.splitlines()
        assert (len(lines), max(map(len, lines)) <= 50) == ((2, True) if is_window else (1, False))
