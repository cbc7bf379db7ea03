"""`inkloop sweep` without processes: what it prints where, what it says, and its exit code."""

from __future__ import annotations

import json
import signal
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop_lab.sweep import command
from inkloop_lab.sweep.task import Bundle, Order, Record, Task, failed
from support.sweeps import Shuffled, record, study

ALPHA = '[vary]\n"components.controller.alpha" = [0.5, 0.8]\n'
Engines = list[tuple[int, Order, Shuffled]]


@pytest.fixture
def engines(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Engines:
    """Engines that the command has made, with the number of processes and the order of each; in an empty folder."""
    made: Engines = []

    def site(workers: int, order: Order) -> Any:
        made.append((workers, order, Shuffled(alpha_of, slots=workers)))
        return nullcontext(made[-1][2].site)

    monkeypatch.setattr(command, "on_processes", site)
    monkeypatch.setattr(command, "fitting", lambda workers, threads: (workers or threads, f"{threads} threads"))
    monkeypatch.chdir(tmp_path)
    return made


def alpha_of(task: Task) -> Record:
    alpha = task.overrides["components.controller.alpha"]
    return failed(task, "gave up") if alpha == 0.123 else record(task, std=1e-6 * alpha, layers=3.0)


def begun(*words: str) -> int:
    return main(["sweep", "study.toml", "--no-pictures", *words])


def test_check_says_nothing_of_pictures_that_cannot_be_drawn(
    engines: Engines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    study(tmp_path, ALPHA)
    for words, is_told in ((["--check"], False), ([], True)):
        assert main(["sweep", "study.toml", *words]) == 0
        assert ("no pictures are written" in "".join(capsys.readouterr())) == is_told


def test_check_prints_nothing_and_says_how_much_it_is(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, f'{ALPHA}"part.height_um" = [10.0, 20.0, 30.0]\n[seeds]\ncount = 4\n')
    assert begun("--check") == 0
    assert "study.toml: 2 alpha x 3 height_um, 4 seeds each: 24 prints" in capsys.readouterr().out
    assert begun("--check", "--json") == 0
    keys = ["components.controller.alpha", "part.height_um"]
    assert json.loads(capsys.readouterr().out) == {"points": 6, "prints": 24, "keys": keys}
    assert not engines
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("[seeds]\ncount = 3\n", "1 point, 3 seeds each: 3 prints"),
        (
            '[seeds]\ncount = 3\nmax = 9\nuntil = { metric = "layers", standard_error = 0.5 }\n',
            "1 point, 3 to 9 seeds each: from 3 prints",
        ),
        (
            '[optimise]\nminimise = "std_um"\ntrials = 5\n[seeds]\ncount = 2\n' + ALPHA,
            "5 trials of 2 prints: 10 prints",
        ),
    ],
)
def test_size_of_a_study_is_told(
    text: str, size: str, engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "optimise" in text:
        pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
    study(tmp_path, text)
    assert begun("--check") == 0
    assert f"study.toml: {size}\n" in capsys.readouterr().out


def test_study_has_a_folder_of_its_own_and_resume_finds_the_newest(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, ALPHA)
    assert begun("--resume") == 1
    assert "runs/study: no study was begun there; leave out --resume" in capsys.readouterr().err
    assert [begun(), begun()] == [0, 0]
    (tmp_path / "runs/study-of-another").mkdir()
    (tmp_path / "runs/study-of-another/study.json").write_text("{}")
    assert {path.parent.name for path in tmp_path.glob("runs/*/sweep.nc")} == {"study", "study-2"}
    capsys.readouterr()
    assert begun("--resume") == 0
    assert "runs/study-2: 2 prints are recorded already" in capsys.readouterr().out
    assert [len(engine.begun) for _, _, engine in engines] == [2, 2, 0]
    assert begun("--out", "runs/study") == 1
    assert "runs/study: holds a study; add --resume to continue it" in capsys.readouterr().err
    assert begun("--out", "elsewhere", "--resume") == 1
    assert "elsewhere: holds no study; leave out --resume" in capsys.readouterr().err


def test_failed_prints_are_counted_and_are_the_exit_code(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, ALPHA.replace("0.5", "0.123") + "[seeds]\ncount = 2\n")
    assert begun("--out", "out", "--json") == 3
    shown = capsys.readouterr()
    assert "2 of 4 prints failed; `error` of out/sweep.nc says why" in shown.err
    assert "2 prints failed: gave up" in shown.err
    assert "out/: sweep.nc, study.html, summary.txt" in shown.err
    found = json.loads(shown.out)
    assert (found["folder"], found["interrupted"], found["prints"], found["failed"]) == ("out", False, 4, 2)
    assert [(point["prints"], point["failed"]) for point in found["points"]] == [(2, 2), (2, 0)]
    assert (found["indices"], found["best"]) == (None, None)
    assert "2 of" not in (tmp_path / "out/summary.txt").read_text()
    assert "4 of 4 prints of " in (tmp_path / "out/study.html").read_text()


def test_interrupted_study_says_how_to_continue(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    study(tmp_path, ALPHA)

    def interrupting(task: Task) -> Record:
        signal.raise_signal(signal.SIGINT)
        return alpha_of(task)

    monkeypatch.setattr(command, "on_processes", lambda *_: nullcontext(Shuffled(interrupting, slots=1).site))
    assert begun("--out", "out", "--workers", "2") == 130
    shown = capsys.readouterr().out
    assert "interrupted: 1 of 2 prints are recorded; continue with" in shown
    words = shown.partition("`inkloop ")[2].partition("`")[0].split()
    assert words == ["sweep", "study.toml", "--out", "out", "--resume", "--workers", "2"]
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "on_processes", lambda *_: nullcontext(Shuffled(alpha_of).site))
    assert main([*words, "--no-pictures"]) == 0


@pytest.mark.parametrize("again", [1, 2])
def test_second_ctrl_c_says_how_to_continue(
    again: int, engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a print ends, or while tables are written."""
    study(tmp_path, ALPHA)

    def press(times: int) -> None:
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)

    def interrupting(task: Task) -> Record:
        press(again)
        return alpha_of(task)

    monkeypatch.setattr(command, "on_processes", lambda *_: nullcontext(Shuffled(interrupting, slots=1).site))
    monkeypatch.setattr("inkloop_lab.sweep.dataset.write", lambda *_: press(1))
    assert begun("--out", "out") == 130
    again_by = "`inkloop sweep study.toml --out out --resume`"
    assert f"interrupted: prints that have ended are kept; continue with {again_by}" in capsys.readouterr().err


def test_error_that_ends_a_study_says_how_to_continue(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(task: Task) -> Record:
        raise ResultError("the disk is full")

    study(tmp_path, ALPHA)
    monkeypatch.setattr(command, "on_processes", lambda *_: nullcontext(Shuffled(full).site))
    assert begun("--out", "out") == 1
    error = capsys.readouterr().err
    assert "the disk is full" in error
    assert "continue with `inkloop sweep study.toml --out out --resume`" in error


@pytest.mark.parametrize(
    ("keep", "folders", "height"),
    [
        ("", False, False),
        ('maps = "all"', True, False),
        ("layers = true", True, False),
        ('maps = "final"', False, True),
    ],
)
def test_prints_keep_what_the_study_asks_for(
    keep: str, folders: bool, height: bool, engines: Engines, tmp_path: Path
) -> None:
    own = study(tmp_path, f"{ALPHA}[keep]\n{keep}\n")
    assert begun("--out", "out") == 0
    ((_, order, _),) = engines
    assert order.runs == (str(tmp_path / "out/prints") if folders else None)
    assert order.with_height is height
    assert order.text == own.scenario.text
    assert Path(order.source).is_file()


@pytest.mark.parametrize("keep", ['maps = "all"', "layers = true"])
def test_run_folders_are_not_written_by_machines_that_may_not_see_the_disk(
    keep: str, engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, f"{ALPHA}[keep]\n{keep}\n")
    assert begun("--scheduler", "tcp://127.0.0.1:9") == 1
    assert f"{keep} writes run folders" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_processes_leave_room_for_the_threads_of_a_print(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, '[vary]\n"components.controller.threads" = [1, 3, 2]\n"components.controller.alpha" = [0.5]\n')
    assert begun("--out", "out") == 0
    assert engines[0][0] == 3
    assert "3 threads at a time" in capsys.readouterr().out
    assert begun("--out", "other", "--workers", "5") == 0
    assert engines[1][0] == 5


def test_best_scenario_of_a_search_is_one_that_prints_so(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
    study(tmp_path, f'[optimise]\nmaximise = "std_um"\ntrials = 4\n{ALPHA}')
    assert begun("--out", "out", "--json") == 0
    shown = capsys.readouterr()
    best = json.loads(shown.out)["best"]
    assert (best["value"], best["keys"]) == (
        pytest.approx(0.8, rel=1e-12, abs=0.0),
        {"components.controller.alpha": 0.8},
    )
    scenario = Scenario.load(tmp_path / "out/best/cuboid.toml")
    assert scenario.tables.components["controller"].options["alpha"] == 0.8
    first = scenario.text.partition("\n")[0] if scenario.text.startswith("#") else ""
    assert first == f"# trial {best['trial']} of study.toml: 0.8"
    assert "largest std_um of 4 trials: alpha 0.8: 0.8; scenario out/best/cuboid.toml" in shown.err


def test_progress_tells_each_print_to_who_asks(
    engines: Engines, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, ALPHA.replace("0.5", "0.123"))
    begun("--out", "out", "--verbose")
    shown = capsys.readouterr().out
    assert "point 0, print 0: failed: gave up" in shown
    assert "point 1, print 0: done: std 8e-07, layers 3" in shown


def test_newest_study_is_the_one_with_the_highest_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options: Any = SimpleNamespace(out=None, resume=True, study=Path("case/study.toml"))
    for name in ("study", "study-of-2", "study-2", "study-9", "study-10", "study-11"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    with pytest.raises(ResultError, match="runs/study: no study was begun there"):
        command._folder(options)
    for name, newest in (
        ("study-of-2", ""),
        ("study", "study"),
        ("study-9", "study-9"),
        ("study-10", "study-10"),
        ("study-2", "study-10"),
    ):
        (tmp_path / "runs" / name / "study.json").write_text("{}")
        if newest:
            assert command._folder(options) == Path("runs") / newest


def test_command_to_continue_names_the_scheduler() -> None:
    options: Any = SimpleNamespace(study=Path("s.toml"), scheduler="tcp://a:1", workers=None)
    assert command._again(Path("out"), options) == "inkloop sweep s.toml --out out --resume --scheduler tcp://a:1"


@pytest.mark.parametrize("kind", ["vary", "optimise"])
def test_files_that_values_of_the_study_name_go_with_each_print(
    kind: str, engines: Engines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    plain = Bundle.of

    def noted(text: str, source: Path, values: Any = ()) -> Any:
        seen.extend(values)
        return plain(text, source)

    monkeypatch.setattr(Bundle, "of", noted)
    text = '[sample]\nmethod = "halton"\npoints = 3\n"components.printer.variation" = { choice = [0.1, 0.2] }\n'
    if kind == "optimise":
        pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
        text = '[optimise]\nminimise = "std_um"\ntrials = 2\n' + text.replace('method = "halton"\npoints = 3\n', "")
    study(tmp_path, f"{ALPHA}{text}")
    assert begun("--check") == 0
    assert [0.5, 0.8] in seen
    assert {0.1, 0.2} == {value for values in seen for value in values if value < 0.5}


def test_failed_prints_are_told_beside_the_bar(
    engines: Engines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, str]] = []

    class Bar:
        def add_task(self, title: str, **_: Any) -> int:
            return 0

        def update(self, bar: int, *, completed: int, total: int, figures: str) -> None:
            shown.append((completed, figures))

    monkeypatch.setattr(Terminal, "progress", lambda self, *notes: nullcontext(Bar()))
    study(tmp_path, ALPHA.replace("0.5, 0.8", "0.123, 0.8, 0.9") + "[seeds]\ncount = 2\n")
    assert begun("--out", "out", "--workers", "1") == 3
    assert shown[-1] == (6, "6 of 6 prints, 2 failed")
    assert [completed for completed, _ in shown] == [1, 2, 3, 4, 5, 6]
