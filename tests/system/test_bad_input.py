"""Inputs that cannot be printed end with a message on place, finding and remedy; nothing is left half written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.component import Port
from inkloop.errors import ComponentError
from inkloop.master.master import Master
from inkloop.results.checkpoint import last
from inkloop.results.result import Result
from support.fmus.amplifier import build
from support.long_proofs import rest_is_long
from support.places import SCENARIOS
from support.toys import FunctionComponent

pytestmark = pytest.mark.usefixtures("without_pictures")

CUBOID = (SCENARIOS / "cuboid.toml").read_text(encoding="utf-8").partition("[compare.")[0]
CUBOID = CUBOID.replace(
    "alpha = 0.8", "alpha = 0.8\nhorizon = 2\nannealing_sweeps = 0"
)  # how well it is planned matters nowhere
COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"
SENSOR = CUBOID[CUBOID.index("[components.profiler]") :]


def lamp(file: str, options: str = "") -> str:
    """The cuboid with a foreign FMU next to the loop."""
    return f'{CUBOID}\n[components.lamp]\nkind = "Fmu"\nfile = "{file}"\n{options}\n'


def wire(source: str, target: str) -> str:
    return f'[[connections]]\nsource = "{source}"\ntarget = "{target}"\n'


def half_written(folder: Path) -> list[str]:
    """Temporary folders of files that are being written."""
    return [path.name for path in folder.rglob("inkloop-part-*")]


AMPLIFIER = "amplifier3.fmu"
PRESS = '[[events]]\nport = "lamp.x"\naction = "override"\nat_layer = 1\n'  # nothing happens before the first layer
TWO = (
    lamp(AMPLIFIER, 'mode = "squared"')
    + f'[components.other]\nkind = "Fmu"\nfile = "{AMPLIFIER}"\n'
    + wire("lamp.y", "other.x")
)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmus")
    build(folder, 3)
    build(folder, 3, platform="riscv64-plan9")
    (folder / "text.fmu").write_text("no archive")
    return folder


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            CUBOID.replace('"LayerMpc"', '"LayerMcp"'),
            "components.controller.kind is 'LayerMcp'; did you mean LayerMpc?",
        ),
        (
            CUBOID.replace("nx = 12", "nx = 12\npitch_um = -263"),
            "grid.pitch_um is -263; expected greater than or equal to 1",
        ),
        (
            lamp(AMPLIFIER, "n = 1") + wire("controller.solve_time", "lamp.x"),
            "controller.solve_time gives [s], lamp.x takes [m]: same quantity needed",
        ),
        (
            lamp(AMPLIFIER) + wire("printer.height", "lamp.x"),
            "printer.height gives 12 x 12, lamp.x takes 3: same shape needed",
        ),
        (
            CUBOID.replace(SENSOR, ""),
            "controller.measured_height is not connected: no other component has an output measured_height",
        ),
        (
            CUBOID + wire("printer.height", "profiler.height") + wire("profiler.measured_height", "profiler.height"),
            "profiler.height is fed twice, by printer.height and profiler.measured_height; keep one",
        ),
        (lamp("nowhere.fmu"), "nowhere.fmu: cannot be read: No such file or directory"),
        (lamp("text.fmu"), "text.fmu: is not a readable FMU: File is not a zip file"),
        (lamp("amplifier3riscv64-plan9.fmu"), "plan9.fmu', which holds binaries for riscv64-plan9, this machine needs"),
        (lamp(AMPLIFIER, "gain = 11"), "components.lamp.gain is 11; expected a number in 0 .. 10"),
        (lamp(AMPLIFIER) + PRESS + "value_um = -1.0\n", "lamp failed at t = 1 s, after layer 1: x: fmi3SetFloat64"),
        (
            TWO + PRESS + "value_um = 1e308\n",
            "lamp failed at t = 1 s, after layer 1: output y is inf in cell (0,)",
        ),
    ],
)
def test_error_is_reported_and_no_file_is_half_written(
    text: str, message: str, fmus: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = fmus / "case.toml"
    path.write_text(text, encoding="utf-8")
    assert main(["run", str(path), "--no-isolate", "--out", str(tmp_path / "run")]) == 1
    assert message in capfd.readouterr().err
    assert half_written(tmp_path) == []


@pytest.fixture(scope="module", params=rest_is_long(["SIGSEGV", "SIGABRT"], 1))
def crash(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path, subprocess.CompletedProcess[str]]:
    """The signal, the scenario, and the print of a loop whose lamp raises it in layer 3."""
    tmp_path = tmp_path_factory.mktemp(request.param)
    path, unpacked = tmp_path / "crash.toml", tmp_path / "unpacked"
    build(tmp_path, 3, crashes=request.param).rename(tmp_path / AMPLIFIER)
    path.write_text(lamp(AMPLIFIER), encoding="utf-8")
    unpacked.mkdir()
    words = [sys.executable, "-c", COMMAND, "run", str(path), "--out", str(tmp_path / "run")]
    environment = {**os.environ, "TMPDIR": str(unpacked)}
    return request.param, path, subprocess.run(words, capture_output=True, text=True, check=False, env=environment)


def test_crash_in_a_step_ends_with_a_message(crash: tuple[str, Path, subprocess.CompletedProcess[str]]) -> None:
    signal_name, path, run = crash
    folder = path.parent / "run"
    assert run.returncode == 1
    assert f"the print was ended by {signal_name}: native code crashed, most likely of components.lamp" in run.stderr
    state = last(folder)
    assert state is not None
    kept = f"layers 0 to {state.layer} are in {folder}; fix the cause, then continue with `inkloop resume {folder}`"
    assert kept in run.stderr
    assert state.layer <= 2
    assert half_written(folder) == []
    assert list((path.parent / "unpacked").iterdir()) == []


@pytest.mark.long
def test_print_resumes_once_the_crashing_fmu_is_repaired(
    crash: tuple[str, Path, subprocess.CompletedProcess[str]], capfd: pytest.CaptureFixture[str]
) -> None:
    signal_name, path, _ = crash
    folder = path.parent
    assert main(["resume", str(folder / "run")]) == 1
    assert f"the print was ended by {signal_name}" in capfd.readouterr().err
    build(folder, 3)
    assert main(["resume", str(folder / "run"), "--no-pictures"]) == 0
    assert main(["run", str(path), "--out", str(folder / "whole"), "--no-isolate"]) == 0
    one, other = (Result.load(folder / name) for name in ("run", "whole"))
    np.testing.assert_array_equal(one.dataset["height"], other.dataset["height"])


OWN = """
import numpy as np

from inkloop import Job


class Late:
    def __init__(self, job: Job) -> None: ...

    def pattern(self, height, layer):
        return undefined_name


class InLibrary(Late):
    def pattern(self, height, layer):
        return np.zeros(3).reshape(7)


class Early(Late):
    def __init__(self, job: Job) -> None:
        self.options = {}["key"]

"""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "Late",
            "controller failed at t = 1 s, after layer 0: NameError: name 'undefined_name' is not defined "
            "(own_controllers.py, line 11)",
        ),
        ("InLibrary", "cannot reshape array of size 3 into shape (7,) (own_controllers.py, line 16)"),
        ("Early", "which cannot be constructed: KeyError: 'key' (own_controllers.py, line 21)"),
    ],
)
def test_error_in_a_class_of_the_user_names_file_and_line(
    name: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own_controllers.py").write_text(OWN, encoding="utf-8")
    begin = CUBOID.index("[components.controller]")
    table = f'[components.controller]\nkind = "own_controllers:{name}"\n\n'
    text = CUBOID[:begin] + table + CUBOID[CUBOID.index("[", begin + 1) :]
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(tmp_path / "case.toml"), "--out", str(tmp_path / "run")]) == 1
    assert message in capsys.readouterr().err


def test_error_within_inkloop_names_no_line(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = {"a": FunctionComponent(outputs=[Port("y")])}
    master = Master(parts, [], step_ns=1)
    monkeypatch.setattr("inkloop.master.master.checked_output", None)
    with pytest.raises(ComponentError, match=r"'NoneType' object is not callable$"):
        master.run(time_max_ns=1)


LEAVER = """
import os


class Leaver:
    inputs = outputs = ()

    def __init__(self, job): ...
    def initialize(self, time_ns, inputs): return {}
    def do_step(self, time_ns, step_ns, inputs): os._exit(0)
    def terminate(self): ...
"""


def test_print_that_a_component_exits_silently_is_no_success(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "leaver.py").write_text(LEAVER, encoding="utf-8")
    path, folder = tmp_path / "leaves.toml", tmp_path / "run"
    path.write_text(f'{CUBOID}\n[components.leaver]\nkind = "leaver:Leaver"\n', encoding="utf-8")
    assert main(["run", str(path), "--isolate", "--out", str(folder)]) == 1
    message = capsys.readouterr().err
    assert "the print was ended by exit code 0x0: native code crashed, of a component or a library" in message
    assert f"layers 0 to 0 are in {folder}; the run cannot be resumed: leaver has no save and no restore" in message


def test_ctrl_c_of_an_isolated_print_keeps_its_layers(tmp_path: Path) -> None:
    path, folder = tmp_path / "slow.toml", tmp_path / "run"
    path.write_text(CUBOID, encoding="utf-8")
    words = ["run", str(path), "--isolate", "--out", str(folder), "--set", "run.real_time_factor=5.0", "--no-pictures"]
    print_it = subprocess.Popen([sys.executable, "-c", COMMAND, *words], start_new_session=True)
    while not (folder / "layers" / "0001.npz").exists():
        assert print_it.poll() is None
        time.sleep(0.01)
    os.killpg(print_it.pid, signal.SIGINT)  # as the terminal does it: to both processes
    assert print_it.wait() == 130
    assert Result.load(folder).run["stop_reason"] == "interrupted"
    assert main(["resume", str(folder)]) == 0


def test_path_that_is_not_ascii_is_as_good_as_any(fmus: Path, tmp_path: Path) -> None:
    folder = tmp_path / "Düse für Tröpfchen 液滴"
    folder.mkdir()
    (folder / "verstärker.fmu").write_bytes((fmus / AMPLIFIER).read_bytes())
    (folder / "würfel.toml").write_text(lamp("verstärker.fmu"), encoding="utf-8")
    plain = ["--no-compare", "--no-pictures", "--set", "run.layers_max=3"]
    assert main(["run", str(folder / "würfel.toml"), *plain, "--out", str(folder / "läufe")]) == 0
    assert Result.load(folder / "läufe").metrics()["layers"] == 3


@pytest.mark.parametrize(
    "place",
    [lambda folder: folder / "case.toml" / "run", lambda folder: Path("/proc/self/fdinfo/run")],
    ids=["below a file", "on a file system that takes none"],
)
def test_folder_that_cannot_be_written_is_named(
    place: Callable[[Path], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "case.toml").write_text(CUBOID, encoding="utf-8")
    out = place(tmp_path)
    assert main(["run", str(tmp_path / "case.toml"), "--out", str(out)]) == 1
    assert str(out) in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]
