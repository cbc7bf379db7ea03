"""The plants of the page on other programs and libraries print, and say what is wrong."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.results.result import Result
from support.places import ROOT

PAGE = (ROOT / "docs/how-to/plant-in-another-program.md").read_text(encoding="utf-8")
DROPLET_UM = 7.6
NX, NY = 6, 4

pytestmark = [pytest.mark.system, pytest.mark.usefixtures("without_pictures")]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the page's files."""
    for name, code in re.findall(r"```(?:python|cpp)\n(?:#|//) (\w+\.\w+)\n(.*?)```", PAGE, re.DOTALL):
        (tmp_path / name).write_text(code, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def scenario_with(folder: Path, plant: str, *edits: tuple[str, str]) -> None:
    """Writes part.toml: an oblong block under the page's table of this plant."""
    (table,) = (text for text in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL) if plant in text)
    for old, new in edits:
        assert old in table
        table = table.replace(old, new)
    lines = (
        'title = "elsewhere"\nseed = 1',
        f"[grid]\nnx = {NX}\nny = {NY}",
        '[part]\nshape = "cuboid"\nsize_x_um = 800.0\nsize_y_um = 300.0\nheight_um = 22.8',
        '[components.controller]\nkind = "LayerMpc"\nhorizon = 1',
        table,
        '[components.profiler]\nkind = "ProfileSensor"\npreset = "exact"\n',
    )
    (folder / "part.toml").write_text("\n".join(lines), encoding="utf-8")


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening


def serve(listening: socket.socket, answer: object = None) -> threading.Thread:
    """A program with columns that stay where they fall; answer: what it says instead."""

    def answers() -> None:
        height = np.zeros((NX, NY))
        connection, _ = listening.accept()
        with connection, connection.makefile("rw", encoding="utf-8") as lines:
            for line in lines:
                height += DROPLET_UM * np.array(json.loads(line))
                lines.write(json.dumps(height.tolist() if answer is None else answer) + "\n")
                lines.flush()

    thread = threading.Thread(target=answers, daemon=True)
    thread.start()
    return thread


def printed(folder: Path) -> np.ndarray:
    assert main(["run", "part.toml", "--out", "run", "--quiet", "--no-pictures", "--no-isolate"]) == 0
    run = Result.load(folder / "run").dataset
    assert run["height"].isel(layer=-1).max() > 0.0
    total = run["pattern"].sum("layer").values
    return np.asarray(run["height"].isel(layer=-1).values - DROPLET_UM * 1e-6 * total)


def test_plant_behind_a_port_prints_what_it_is_told(desk: Path, server: socket.socket) -> None:
    scenario_with(desk, "tcp_plant", ("port = 5555", f"port = {server.getsockname()[1]}"))
    thread = serve(server)
    np.testing.assert_allclose(printed(desk), 0.0, atol=1e-12)
    thread.join(60.0)
    assert not thread.is_alive()


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++, which `make tools` installs")
def test_plant_in_a_library_prints_what_it_is_told(desk: Path) -> None:
    (command,) = re.findall(r"^    (g\+\+ .*)$", PAGE, re.MULTILINE)
    subprocess.run(command.split(), check=True, cwd=desk)
    scenario_with(desk, "library_plant", ("/home/me/libbed.so", str(desk / "libbed.so")))
    np.testing.assert_allclose(printed(desk), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("answer", "said"),
    [([[0.0]], "shape (1, 1); needs (6, 4)"), ("no", "no surface from the plant")],
    ids=["other grid", "text"],
)
def test_wrong_answer_of_a_program_is_named(
    answer: object, said: str, desk: Path, server: socket.socket, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario_with(desk, "tcp_plant", ("port = 5555", f"port = {server.getsockname()[1]}"))
    serve(server, answer)
    assert main(["run", "part.toml", "--out", "run", "--quiet", "--no-pictures", "--no-isolate"]) == 1
    assert said in " ".join(capsys.readouterr().err.split())


def test_program_that_does_not_run_is_named(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    scenario_with(desk, "tcp_plant", ("port = 5555", f"port = {port}"))
    assert main(["run", "part.toml", "--out", "run", "--quiet", "--no-pictures", "--no-isolate"]) == 1
    assert f"no plant listens on 127.0.0.1:{port}" in " ".join(capsys.readouterr().err.split())
