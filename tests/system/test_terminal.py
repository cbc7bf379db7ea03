"""Terminal output of a run in a window of 60, 80 and 120 columns, also while the run has not ended."""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest

import inkloop
from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.results.lock import sole_writer
from inkloop.results.result import COMPARE_FOLDER, RESULT_FILE, Result
from support.long_proofs import rest_is_long
from support.other_process import HOLDING, other_process

SCENARIO = Path(__file__).parents[2] / "scenarios" / "cuboid.toml"
TITLE, LABEL = "Cube [batch 3]", "run [/b] 5$ of $\\frac"
HOSTILE = {"title": TITLE, "label": LABEL}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose title and label look like markup and like a formula."""
    folder: Path = tmp_path_factory.mktemp("terminal") / "run"
    inkloop.run(SCENARIO, HOSTILE, run={"layers_max": 2}, out=folder)
    return folder


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals of this kind")
@pytest.mark.parametrize("columns", rest_is_long([60, 80, 120], 1))
def test_table_of_a_run_is_whole_in_a_window(folder: Path, columns: int) -> None:
    text = in_a_window(columns, "compare", "--no-pictures", str(folder))
    lines = text.splitlines()
    assert LABEL.split()[0] in text
    assert "[/b]" in text
    assert "…" not in text
    assert max(map(len, lines)) <= columns
    row = next(line for line in lines if line.startswith("run ["))
    assert len(re.findall(r"-?\d+\.\d\d", row)) == 5


def test_texts_of_a_user_reach_table_and_pictures(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert TITLE in shown
    assert LABEL in shown
    assert (folder / "layers.png").stat().st_size > 10_000


def test_figures_of_a_run_come_as_json(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "--json", "--no-pictures", str(folder)]) == 0
    record = json.loads(capsys.readouterr().out)
    metrics = inkloop.load(folder).metrics()
    assert record["runs"][LABEL]["mean_error_um"] == pytest.approx(metrics["mean_error"] * 1e6, rel=1e-12, abs=0.0)
    assert record["runs"][LABEL]["layers"] == 2
    assert main(["validate", "--json", "missing.toml"]) == 1
    assert "No such file" in json.loads(capsys.readouterr().out)["errors"][0]


@pytest.mark.parametrize("has_result", [True, False], ids=["resumed", "first"])
def test_run_that_has_not_ended_is_described(
    folder: Path, has_result: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`has_result`: of a run that was interrupted and is being resumed, with the result of its first part."""
    Result.begin(tmp_path, "", {"process": -1})
    if has_result:
        (tmp_path / RESULT_FILE).write_bytes((folder / RESULT_FILE).read_bytes())
    for command in ("info", "report", "compare"):
        assert main([command, str(tmp_path)]) == 1
        assert f"Continue with `inkloop resume {tmp_path}`" in capsys.readouterr().err
    with other_process(HOLDING, str(tmp_path)) as process:
        for command in ("info", "report", "compare"):
            assert main([command, str(tmp_path)]) == 1
            assert f"being printed by process {process.pid} since" in capsys.readouterr().err


def test_compared_run_is_being_printed_by_the_process_that_prints_the_whole(tmp_path: Path) -> None:
    """Its lock is that of the folder in which `compare` stands."""
    compared = tmp_path / COMPARE_FOLDER / "open loop"
    Result.begin(compared, "", {"process": -1})
    with pytest.raises(ResultError, match="Continue with `inkloop resume"):
        Result.load(compared)
    with (
        other_process(HOLDING, str(tmp_path)) as process,
        pytest.raises(ResultError, match=f"being printed by process {process.pid} since"),
    ):
        Result.load(compared)


def test_process_that_prints_can_ask_for_its_own_run_and_keeps_the_lock(tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
from inkloop.results.lock import sole_writer
from inkloop.results.result import Result
folder = Path({str(tmp_path)!r})
with sole_writer(folder):
    Result.begin(folder, "", {{}})
    try:
        Result.load(folder)
    except Exception as error:
        assert "being printed by this process" in str(error), error
    print("held", flush=True)
    input()
"""
    with other_process(program), pytest.raises(ResultError, match="another run writes here"):
        sole_writer(tmp_path).__enter__()


def in_a_window(columns: int, *arguments: str) -> str:
    """Output of `inkloop ARGUMENTS` in a pseudo-terminal, without the sequences that set colours."""
    import fcntl
    import pty
    import termios

    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    environment = {**os.environ, "TERM": "xterm"}
    environment.pop("COLUMNS", None)
    command = [sys.executable, "-c", "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"]
    process = subprocess.Popen([*command, *arguments], stdin=slave, stdout=slave, stderr=slave, env=environment)
    os.close(slave)
    shown = b""
    while piece := _read(master):
        shown += piece
    os.close(master)
    assert process.wait() == 0
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode().replace("\r\n", "\n"))


def _read(terminal: int) -> bytes:
    """More of what a pseudo-terminal shows; nothing once the process has closed it."""
    try:
        return os.read(terminal, 1 << 16)
    except OSError:
        return b""
