"""What cannot be printed ends in words that say where, what was found and what to do; nothing is left half written."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from amplifier import build
from inkloop.cli import main
from inkloop.component import Port
from inkloop.errors import ComponentError
from inkloop.master import Master
from inkloop.result import Result
from inkloop.wiring import Connection
from toys import FunctionComponent

CUBOID = (Path(__file__).parents[2] / "scenarios" / "cuboid.toml").read_text(encoding="utf-8").partition("[compare.")[0]
SENSOR = CUBOID[CUBOID.index("[components.profiler]") :]


def lamp(file: str, options: str = "") -> str:
    """The cuboid with a foreign FMU beside the loop."""
    return f'{CUBOID}\n[components.lamp]\nkind = "Fmu"\nfile = "{file}"\n{options}\n'


def wire(source: str, target: str) -> str:
    return f'[[connections]]\nsource = "{source}"\ntarget = "{target}"\n'


def half_written(folder: Path) -> list[str]:
    """Files under their temporary name, which a reader would not know from whole ones."""
    return [path.name for path in folder.rglob("*") if path.name.endswith(".part")]


AMPLIFIER = "amplifier3.fmu"
PRESS = '[[events]]\nport = "lamp.x"\naction = "override"\nat_layer = 1\n'  # nothing happens before the first layer
TWO = (
    lamp(AMPLIFIER, "gain = 10.0")
    + f'[components.other]\nkind = "Fmu"\nfile = "{AMPLIFIER}"\n'
    + wire("lamp.y", "other.x")
)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmus")
    build(folder, 3)
    build(folder, 3, platform="riscv64-plan9")
    build(folder, 3, crashes=True)
    (folder / "text.fmu").write_text("no archive")
    return folder


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            CUBOID.replace('"LayerMpc"', '"LayerMcp"'),
            "components.controller.kind is 'LayerMcp'; did you mean LayerMpc?",
        ),
        (CUBOID.replace("nx = 12", "nx = 12\npitch_um = -263"), "grid.pitch_um is -263; expected greater than 0"),
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
            TWO + PRESS + "value_m = 1e308\n",
            "lamp failed at t = 1 s, after layer 1: output y is inf in cell (0,)",
        ),
    ],
)
def test_it_is_told_and_no_file_is_half_written(
    text: str, said: str, fmus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = fmus / "case.toml"
    path.write_text(text, encoding="utf-8")
    assert main(["run", str(path), "--out", str(tmp_path / "run")]) == 1
    assert said in capsys.readouterr().err
    assert half_written(tmp_path) == []


def nan_after(steps: int) -> FunctionComponent:
    return FunctionComponent(
        outputs=[Port("y", shape=(2,))],
        step=lambda time_ns, step_ns, values: {"y": np.array([0.0, np.nan if time_ns >= steps else 0.0])},
    )


def test_nan_that_somebody_reads_ends_the_run_with_its_cell() -> None:
    parts = {"a": nan_after(3), "b": FunctionComponent(inputs=[Port("x", shape=(2,))])}
    master = Master(parts, [Connection("a.y", "b.x")], step_ns=1)
    with pytest.raises(ComponentError, match=r"a failed at t = 3e-09 s: output y is nan in cell \(1,\)"):
        master.run(time_max_ns=10)
    assert parts["b"].log[-1] == "terminate"


def loop_of(start: float) -> Master:
    ports = {"inputs": [Port("u")], "outputs": [Port("y", start=start)]}
    parts = {name: FunctionComponent(**ports, start=lambda values: {"y": np.asarray(1.0)}) for name in ("a", "b")}
    return Master(parts, [Connection("a.y", "b.u"), Connection("b.y", "a.u")], step_ns=1)


def test_loop_without_start_value_is_refused_before_anything_starts() -> None:
    with pytest.raises(ComponentError, match=r"a\.u stands in a loop with b\.y, which has no start value"):
        loop_of(float("nan")).run(time_max_ns=3)
    assert loop_of(0.0).run(time_max_ns=0) == "time_max"


def test_crash_in_a_step_ends_in_words(fmus: Path, tmp_path: Path) -> None:
    path = fmus / "crash.toml"
    path.write_text(lamp("amplifier3-crashes.fmu"), encoding="utf-8")
    command = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ["run", str(path), "--isolate", "--out", str(tmp_path / "run")]
    run = subprocess.run([sys.executable, "-c", command, *words], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert "the process was ended by SIGABRT: native code of a component, an FMU or a library, crashed" in run.stderr
    assert half_written(tmp_path) == []


def test_isolated_run_is_the_same_run(fmus: Path, tmp_path: Path) -> None:
    path = fmus / "good.toml"
    path.write_text(CUBOID, encoding="utf-8")
    for name, flags in (("plain", []), ("isolated", ["--isolate"])):
        assert main(["run", str(path), *flags, "--out", str(tmp_path / name)]) == 0
    one, other = (Result.load(tmp_path / name) for name in ("plain", "isolated"))
    np.testing.assert_array_equal(one.dataset["height"], other.dataset["height"])


def test_path_that_is_not_ascii_is_as_good_as_any(fmus: Path, tmp_path: Path) -> None:
    folder = tmp_path / "Düse für Tröpfchen 液滴"
    folder.mkdir()
    (folder / "verstärker.fmu").write_bytes((fmus / AMPLIFIER).read_bytes())
    (folder / "würfel.toml").write_text(lamp("verstärker.fmu"), encoding="utf-8")
    assert main(["run", str(folder / "würfel.toml"), "--out", str(folder / "läufe")]) == 0
    assert Result.load(folder / "läufe").metrics()["layers"] >= 3


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
