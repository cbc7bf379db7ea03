"""The command reports what it did, or the error, and ends with an exit code."""

from __future__ import annotations

import argparse
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from inkloop.cli import RENAMED, main, parser
from inkloop.results.recorder import LayerRow
from inkloop.results.result import Result
from support.long_proofs import rest_is_long
from support.prints import quick_cuboid

CUBOID = str(quick_cuboid())


def test_run_leaves_a_folder_and_report_makes_table_and_pictures_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "cuboid"
    assert main(["run", CUBOID, "--out", str(folder)]) == 0
    names = {path.name for path in folder.iterdir()}
    pictures = {"surface.png", "cross-section.png", "error-map.png", "layers.png", "open-against-closed.png"}
    assert names >= pictures | {"result.nc", "run.json", "scenario.toml", "summary.txt", "compare"}
    assert not [name for name in names if name.startswith("inkloop-part-")]
    summary, layers = (folder / "summary.txt").read_text(), (folder / "layers.png").read_bytes()
    assert "open loop" in summary
    assert str(folder) in capsys.readouterr().out.replace("\n", "")
    for name in ("summary.txt", "layers.png"):
        (folder / name).unlink()
    assert main(["report", str(folder)]) == 0
    assert (folder / "summary.txt").read_text() == summary
    assert (folder / "layers.png").read_bytes() == layers


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("kind", rest_is_long(["LayerMpc", "LayerController"], 1))
def test_alpha_that_prints_nothing_is_an_error_that_says_what_prints(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def printed(folder: str, *overrides: str) -> int:
        chosen = [f"components.controller.{override}" for override in (f"kind={kind}", *overrides)]
        small = ("run.layers_max=1", "part.size_x_um=800.0", "part.size_y_um=800.0")
        options = [word for override in (*chosen, *small) for word in ("--set", override)]
        return main(["run", CUBOID, "--no-compare", "--out", str(tmp_path / folder), *options])

    assert printed("none", "horizon=1", "alpha=0.05") == 1
    message = capsys.readouterr().err
    assert "controller: nothing was printed with alpha = 0.05, horizon = 1" in message
    assert "Traceback" not in message
    assert "choose a larger alpha or a longer horizon" in message
    assert printed("alpha", "horizon=1", "alpha=0.8") == 0
    assert printed("horizon", "horizon=3", "alpha=0.05") == 0
    assert "nothing was printed" not in capsys.readouterr().out


@pytest.mark.long
def test_run_that_prints_nothing_ends_with_a_message_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "cuboid"
    assert main(["run", CUBOID, "--no-compare", "--out", str(folder), "--set", "part.height_um=0.01"]) == 0
    assert "nothing was printed" in capsys.readouterr().out
    assert (folder / "layers.png").exists()


def test_validate_answers_with_an_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", CUBOID]) == 0
    assert "no errors" in capsys.readouterr().out
    assert main(["validate", CUBOID, "--set", "grid.nx=0"]) == 1
    assert "grid.nx is 0" in capsys.readouterr().err


def test_export_and_info_show_the_same_grid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "printer.fmu"
    assert main(["export", "fmu", "LayerDeposition", "--fmi", "2", "--nx", "4", "--ny", "5", "--out", str(path)]) == 0
    assert main(["info", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "LayerDeposition" in shown
    assert "4 x 5" in shown
    assert "layer_command" in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["report", "absent"], "run.json"),
        (["info", "absent.fmu"], "absent.fmu"),
        (["run", "absent.toml"], "absent.toml"),
        (["export", "fmu", "LayerDepositoin"], "LayerDeposition"),
    ],
)
def test_errors_are_reported_without_a_traceback(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 1
    assert message in capsys.readouterr().err


def usage_of(*words: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Output for a command line that is refused; its exit code is 2."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "usage", "message"),
    [
        (["runn"], "usage: inkloop ", "there is no command 'runn'; did you mean run?"),
        (["exprot"], "usage: inkloop ", "there is no command 'exprot'; did you mean export?"),
        (["valid"], "usage: inkloop ", "there is no command 'valid'; did you mean validate?"),
        (["export", "sps", CUBOID], "usage: inkloop export ", "there is no command 'sps'; did you mean ssp?"),
        (["validate", CUBOID, "--no-such-option"], "usage: inkloop validate ", "unknown arguments: --no-such-option"),
        (["--print-completion", "nosh"], "usage: inkloop ", "expected one of bash, zsh"),
    ],
)
def test_mistyped_word_is_named(typed: list[str], usage: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    output = usage_of(*typed, capsys=capsys)
    assert output.startswith(usage)
    assert message in output


@pytest.mark.parametrize("old", RENAMED)
def test_old_name_of_a_command_gives_the_new_one(old: str, capsys: pytest.CaptureFixture[str]) -> None:
    above, _, names = RENAMED[old].partition(" ")
    said = f"; `inkloop {old}` is now `inkloop {above} {names}`"
    assert said in usage_of(*old.split(), CUBOID, capsys=capsys)
    assert {(above, name) for name in names.split("|")} <= set(commands())


def commands() -> list[tuple[str, ...]]:
    """The words of every command."""

    def below(one: argparse.ArgumentParser, *words: str) -> Iterator[tuple[str, ...]]:
        parts = [action for action in one._actions if isinstance(action, argparse._SubParsersAction)]
        for part in parts:
            for name, command in part.choices.items():
                yield from below(command, *words, name)
        if not parts:
            yield words

    return list(below(parser()))


def test_at_most_sixteen_commands_stand_at_the_top() -> None:
    assert len({words[0] for words in commands()}) <= 16


@pytest.mark.parametrize("command", commands(), ids=" ".join)
def test_wrong_option_shows_the_usage_of_its_command(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert usage_of(*command, "--no-such-option", capsys=capsys).startswith(f"usage: inkloop {' '.join(command)} ")


@pytest.mark.parametrize("command", commands(), ids=" ".join)
def test_help_explains_every_argument(command: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*command, "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert any("--traceback" in line for line in lines)
    entries = [line for line in lines if re.match(r"  \S", line) and not line.startswith("  -h")]
    below = {line: lines[lines.index(line) + 1] if line != lines[-1] else "" for line in entries}
    bare = [line for line in entries if "  " not in line.strip() and not below[line].startswith("    ")]
    assert not bare


def test_traceback_shows_error_and_cause(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "absent.toml", "--traceback"]) == 1
    output = capsys.readouterr().err
    assert output.count("Traceback (most recent call last)") == 2
    assert output.index("FileNotFoundError") < output.index("inkloop.errors.ScenarioError: absent.toml: ")


@pytest.mark.parametrize(
    ("typed", "offered"),
    [(["ru"], "run"), (["export", "ssp", "--ss"], "--ssp"), (["new", "--shape", "cy"], "cylinder")],
)
def test_completion_script_completes_in_bash(
    typed: list[str], offered: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--print-completion", "bash"])
    assert ended.value.code == 0
    words = " ".join(["inkloop", *typed])
    ask = f"COMP_WORDS=({words}); COMP_CWORD={len(typed)}; _shtab_inkloop; echo ${{COMPREPLY[@]}}"
    script = f"{capsys.readouterr().out}\n{ask}\n"
    shell = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert offered in shell.stdout.split()


@pytest.mark.parametrize("at_layer", rest_is_long([2, 4], 1))
def test_ctrl_c_keeps_the_layers_that_are_printed(
    at_layer: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Layer 2 is within the print, layer 4 the last one before the run is saved."""

    def press(bar: object, row: LayerRow) -> None:
        if row.layer == at_layer:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("inkloop.printing.run._LayerBar.__call__", press)
    monkeypatch.setattr("inkloop.report.pictures.pictures", lambda runs: {"surface": Figure()})  # of the layers kept
    folder = tmp_path / "run"
    assert main(["run", CUBOID, "--out", str(folder), "--set", "run.layers_max=4"]) == 130
    kept = Result.load(folder).dataset
    assert kept.sizes["layer"] == at_layer + 1
    assert (folder / "summary.txt").exists()
    assert (folder / "surface.png").exists()
    assert not (folder / "compare").exists()


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("place", ["print", "report"])
def test_second_ctrl_c_says_how_to_continue(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """While the step of the first one ends, or while tables are written after it."""

    def press(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    def press_at_layer(bar: object, row: LayerRow) -> None:
        for _ in range(row.layer // 2 if place == "report" else row.layer):
            press()

    monkeypatch.setattr("inkloop.printing.run._LayerBar.__call__", press_at_layer)
    monkeypatch.setattr("inkloop.report.run_report.write", press)
    folder = tmp_path / "run"
    words = ["run", CUBOID, "--out", str(folder), "--set", "run.layers_max=3"]
    assert main(words) == 130
    layers = 1 if place == "print" else 2
    assert f"interrupted: layers 0 to {layers} are in {folder}; continue with `inkloop resume {folder}`" in (
        capsys.readouterr().err
    )
    monkeypatch.undo()
    assert main(["resume", str(folder), "--no-pictures"]) == 0


@pytest.mark.usefixtures("without_pictures")
def test_run_in_real_time_records_its_deadlines_and_overrides(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    pace = ["--set", "run.real_time_factor=1000.0", "--set", "seed=5"]
    assert main(["run", CUBOID, "--no-compare", "--out", str(folder), *pace]) == 0
    result = Result.load(folder)
    assert result.run["seed"] == 5
    assert "seed = 5" in (folder / "scenario.toml").read_text()
    account = result.run["real_time"]
    assert account["steps"] == result.dataset.time[-1] + 1  # the controller ends the run a step after the last layer
    assert 0 <= account["missed"] <= account["steps"]
    assert 0 <= account["p99_s"] <= account["worst_s"]
    assert f"of {account['steps']} steps late" in " ".join(capsys.readouterr().out.split())
