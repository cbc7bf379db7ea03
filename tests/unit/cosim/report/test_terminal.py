"""The terminal: texts and numbers stay whole, sentences break between words, results come as JSON where asked for."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import pytest
from rich.progress import BarColumn, Progress, TextColumn

from inkloop.cli import main
from inkloop.report import wrapped
from inkloop.report.terminal import Terminal, decimals, number_table

HOSTILE = "run [/b] [red]5$[/] :smile:"


def shown(width: int, name: str = "closed loop") -> str:
    table = number_table(
        "run", "mean\nerror", "mae", "std", "mis-\nmatch", "layers", "droplets", "wall\n[s]", title="T"
    )
    table.add_row(name, "-1234.56", "0.30", "0.35", "12.3%", "1792", "13579246", "98765.43")
    text = io.StringIO()
    Terminal(text, width=width).print(table)
    return text.getvalue()


@pytest.mark.parametrize("width", [60, 80, 120])
def test_every_number_is_whole_at_any_width(width: int) -> None:
    text = shown(width)
    assert "…" not in text
    for number in ("-1234.56", "0.30", "0.35", "12.3%", "1792", "13579246", "98765.43"):
        assert number in text
    assert max(map(len, text.splitlines())) <= width


def test_text_of_a_user_is_no_markup() -> None:
    assert HOSTILE in shown(120, HOSTILE)
    text = io.StringIO()
    terminal = Terminal(text, width=120)
    terminal.sentence(HOSTILE)
    with terminal.progress("figures") as progress:
        progress.add_task(HOSTILE, figures=HOSTILE, total=1)
    assert text.getvalue().count(HOSTILE) == 3  # the sentence, the task and its note


OBEYED = "\x1b[31m, \x9b2J, \x07, \u202etxt.exe, \udcff"


def test_control_characters_of_a_text_are_escapes_wherever_it_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    text = io.StringIO()
    terminal = Terminal(text, width=120)
    table = number_table("run", title=OBEYED, caption=OBEYED)
    table.add_row(OBEYED)
    terminal.print(table)
    terminal.print(OBEYED)
    terminal.sentence(OBEYED)
    with terminal.progress("figures") as progress:
        progress.add_task(OBEYED, figures=OBEYED, total=1)
    assert text.getvalue().count(r"\x1b[31m, \x9b2J") == 7
    Terminal(quiet=True).failures([OBEYED])
    assert main(["info", f"{OBEYED}.fmu"]) == 1
    with pytest.raises(SystemExit):
        main(["info", "a", f"{OBEYED}.fmu"])
    streams = capsys.readouterr()
    assert streams.err.count(r"\x1b[31m, \x9b2J") == 3
    for letter in set(OBEYED) - {chr(code) for code in range(32, 127)}:
        assert letter not in text.getvalue() + streams.out + streams.err


def test_file_has_the_same_text_in_a_notebook_which_asks_for_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = shown(120)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert shown(120) == expected


def test_json_has_standard_output_for_itself(capsys: pytest.CaptureFixture[str]) -> None:
    terminal = Terminal(as_json=True)
    terminal.sentence("a sentence")
    terminal.result(file=Path("a.fmu"), numbers=[1.5, math.nan, {"inf": math.inf}])
    streams = capsys.readouterr()
    assert json.loads(streams.out) == {"file": "a.fmu", "numbers": [1.5, None, {"inf": None}]}
    assert "a sentence" in streams.err


def test_quiet_terminal_writes_nothing_but_failures(capsys: pytest.CaptureFixture[str]) -> None:
    for quiet, expected in ((True, "the bus is off\n"), (False, "")):
        Terminal(quiet=quiet).failures(["the bus is off"])
        assert capsys.readouterr().err == expected
    terminal = Terminal(quiet=True)
    terminal.sentence("a sentence")
    terminal.result(number=1)
    progress: Progress
    with terminal.progress() as progress:
        progress.add_task("task", total=1)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(("width", "columns"), [(69, "a"), (70, "a"), (99, "a"), (100, "ab")])
def test_notes_beside_a_bar_are_those_that_there_is_room_for(width: int, columns: str) -> None:
    with Terminal(io.StringIO(), width=width).progress("a", "b") as progress:
        shown = [column.text_format for column in progress.columns if isinstance(column, TextColumn)]
        bars = [column for column in progress.columns if isinstance(column, BarColumn)]
    assert shown == ["{task.description}", *(f"{{task.fields[{name}]}}" for name in columns)]
    assert len(bars) == (width >= 70)


def test_what_rounds_to_zero_has_no_sign() -> None:
    assert decimals(-0.001) == "0.00"
    assert decimals(-0.005001) == "-0.01"
    assert decimals(math.nan) == "nan"


ERROR = "cube.toml: 1 error\n  - part reaches beyond the grid; continue with `inkloop resume runs/my run` after it"


@pytest.mark.parametrize("columns", [30, 60, 80])
def test_words_and_quoted_commands_stay_whole(columns: int) -> None:
    lines = wrapped(ERROR, columns).split("\n")
    assert " ".join(" ".join(lines).split()) == " ".join(ERROR.split())
    assert any("`inkloop resume runs/my run`" in line for line in lines)
    assert max(len(line) for line in lines) <= columns or columns == 30


def test_lines_of_an_item_begin_below_its_text_and_text_that_fits_stays() -> None:
    assert wrapped(ERROR, 40).split("\n")[1:3] == ["  - part reaches beyond the grid;", "    continue with"]
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
