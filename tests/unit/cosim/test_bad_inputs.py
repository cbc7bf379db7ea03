"""Errors in inputs of a user: each ends with a message on place, finding and remedy, and writes nothing."""

from __future__ import annotations

import json
import os
import shlex
import stat
import zipfile
from pathlib import Path

import pytest

from inkloop.cli import main
from inkloop.results import result
from support.places import SCENARIOS

CUBOID = (SCENARIOS / "cuboid.toml").read_text(encoding="utf-8").partition("[compare.")[0]
CUBOID = CUBOID[CUBOID.index("title =") :]
PROFILER = CUBOID[CUBOID.index("[components.profiler]") :]
CONTROLLER = CUBOID[CUBOID.index("[components.controller]") : CUBOID.index("[components.printer]")]
MAPS = '[components.profiler]\nkind = "MapFolder"\nfolder = "scans"\nunit = "um"\npixel_um = 5.0\n'

SCENARIO_ERRORS = {
    "key misspelt": ("alpha = 0.8", "alhpa = 0.8", "components.controller.alhpa is not a key of this table; did you m"),
    "key in another unit": ("height_um = 22.8", "height_mm = 0.0228", "height_mm is in mm; write height_um = 22.8"),
    "key without unit": ("height_um = 22.8", "height = 22.8", "part.height_um is missing; add it (height of"),
    "kind misspelt": ('"LayerMpc"', '"LayerMcp"', "components.controller.kind is 'LayerMcp'; did you mean LayerMpc?"),
    "option too large": ("variation = 0.2", "variation = 20", "variation is 20; expected a number in 0.0 .. 1.0"),
    "weight too large": ("alpha = 0.8", "alpha = 1.8", "alpha is 1.8; needs a weight between 0"),
    "no horizon": ("alpha = 0.8", "horizon = 0", "horizon is 0; needs 1 to 5 layers ahead"),
    "choice misspelt": ('"per_droplet"', '"per_drop"', "variation_kind is 'per_drop'; expected one of 'per_droplet'"),
    "not a number": ("height_um = 22.8", "height_um = nan", "part.height_um is nan; expected a finite number"),
    "infinite": ("height_um = 22.8", "height_um = inf", "part.height_um is inf; expected a finite number"),
    "ink far too high": ("[grid]", "[ink.a]\nh1_um = 2e3\n[grid]", "ink.a.h1_um is 2000.0; expected less than or equa"),
    "substrate far too high": ("[grid]", "[substrate]\ntilt_x = 200.0\n[grid]", "within 0.4 m; check [subst"),
    "far too high": ("height_um = 22.8", "height_um = 1e9", "target_height is 1000 at cell (2, 2); needs heights in m"),
    "negative": ("size_x_um = 2106.048", "size_x_um = -2106.0", "part.size_x_um is -2106.0; expected greater than 0"),
    "text for a number": ("height_um = 22.8", 'height_um = "22.8 um"', "expected a number, without quotes and without"),
    "word for a number": ("seed = 1", 'seed = "one"', "seed is 'one'; expected a whole number"),
    "half a cell": ("nx = 12", "nx = 12.5", "grid.nx is 12.5; expected a whole number (cells along x)"),
    "missing key": ("nx = 12\n", "", "grid.nx is missing; add it (cells along x)"),
    "missing table": ("[grid]", "[gird]", "gird is not a key of this table; did you mean grid?"),
    "part off the grid": ("size_x_um = 2106.048", "size_x_um = 9e3", "it is 9000 x 2106.05 µm wide; with grid.nx >= 3"),
    "part without a cell": ("size_x_um = 2106.048", "size_x_um = 20.0", "it is 20 x 2106.05 µm wide, a cell 263.256 "),
    "pitch in metres": ("nx = 12", "nx = 12\npitch_um = 0.000263", "grid.pitch_um is 0.000263; expected greater than "),
    "giant grid": ("nx = 12", "nx = 1000000000", "GiB are available; |would fit: choose a smaller grid"),
    "mesh as shape": ('"cuboid"', '"my_part.stl"', 'a file is printed with shape = "mesh", "stack" or "height-map"'),
    "no profiler": (PROFILER, "", 'add a profiler, e.g. [components.profiler] with kind = "ProfileSensor"'),
    "missing module": ('"LayerMpc"', '"nowhere:Control"', "No module named 'nowhere'; looked for modules in |next to "),
    "missing class": ('"LayerMpc"', '"shlex:Control"', "module 'shlex' has no attribute 'Control'; known: shlex"),
    "class without job": ('"LayerMpc"\nalpha = 0.8', '"string:Formatter"',
                          "Formatter() takes no arguments; |a class takes the job, then options by keyword"),
    "missing ink file": ("[grid]", '[ink]\nfile = "my-ink.toml"\n[grid]', "ink.file is |; name an ink file, relative"),
    "no controller": (CONTROLLER, "", 'add a controller, e.g. [components.controller] with kind = "LayerMpc"'),
    "MapFolder at a model": (PROFILER, MAPS, 'simulates a printer, |add a component with kind = "Shadow"'),
    "missing FMU": ("[components.printer]", '[components.lamp]\nkind = "Fmu"\nfile = "lamp.fmu"\n[components.printer]',
                    "components.lamp.file: |lamp.fmu: cannot be read: |give its path from the scenario's folder"),
    "port of a connection": ("[grid]", '[[connections]]\nsource = "printer.hight"\ntarget = "profiler.height"\n[grid]',
                             "printer.hight: printer has no output 'hight'; did you mean height?"),
    "port of an event": ("[grid]",
                         '[[events]]\nport = "printer.hight"\naction = "bias"\nat_layer = 1\nvalue_um = 1.0\n[grid]',
                         "events.[0].port is 'printer.hight': printer has no port 'hight'; did you mean height?"),
    "action of an event": ("[grid]", '[[events]]\nport = "printer.height"\naction = "bais"\nat_layer = 1\n[grid]',
                           "events.[0].action is 'bais'; expected 'override', 'bias' or 'reset'"),
    "negative ink": ("[grid]", "[ink.a]\nh1_um = 4.4\nh2_um = -0.6\nh3_um = 0.2\n[grid]", "ink.a.h2_um is -0.6; expec"),
    "letter that no key has": ("height_um", "höhe_um", "line 13, `höhe_um = 22.8`: a key without quotes has no 'ö'; k"),
    "micro sign in a key": ("height_um", "height_µm", "a key without quotes has no 'µ'; write um"),
    "key twice": ("nx = 12", "nx = 12\nnx = 13", "line 7, `nx = 13`: this key or table is there already; keep one of"),
    "text without quotes": ('"closed loop"', "closed loop", 'line 2, |or a text in quotes: label = "..."'),
    "open bracket": ("[grid]", "[grid", "line 5, `[grid`: Expected ']'"),
}  # fmt: skip
"""Name -> what of the cuboid is replaced, by what, and pieces of the message, joined by |."""

COMMANDS = {
    "validate missing.toml": "missing.toml: |cannot be read: No such file or directory; known: cube.toml",
    "validate cub.toml": "did you mean cube.toml?",
    "validate cube": "is neither a file nor a scenario of inkloop; did you mean cube.toml?",
    "validate .": "is a folder; name a scenario in it: cube.toml",
    "validate cube.toml --set grid.nx": "--set grid.nx: expected KEY=VALUE, e.g. --set components.controller.alpha=0.5",
    "validate cube.toml --set grid.nxx=12": "grid.nxx is not a key of this table; did you mean nx?",
    "validate cube.toml --set grid.nx=abc": "grid.nx is 'abc'; expected a whole number (cells along x)",
    "run cube.toml --out full": "full: is there already and not empty; name another --out, nothing is overwritten",
    "run cube.toml --ouut x": "2 inkloop run: error: unknown arguments: --ouut x; did you mean --out?",
    "run cube.toml --set grid=5": "grid is 5; expected a table, [grid]",
    "run cube.toml --pictures jpg": "2 there is no picture format 'jpg'; expected png, svg, pdf, or several with comma",
    "": "2 name a command; `inkloop --help` lists them",
    "runn cube.toml": "2 there is no command 'runn'; did you mean run?",
    "report full": "full: holds no run.json; name a folder that `inkloop run` has made",
    "resume full": "full: holds no run.json; name a folder that `inkloop run` has made",
    "compare full": "full: holds no run.json; name a folder that `inkloop run` has made",
    "bench replay full": "full: holds no run.json; name a folder that `inkloop run` has made",
    "export layers full": "full: holds no run.json; name a folder that `inkloop run` has made",
    "export surface full --format stl": "full: holds no run.json; name a folder that `inkloop run` has made",
    "info full": "full: holds no run.json; name a folder that `inkloop run` has made",
    "info nope": "nope: is not there; name an .fmu file, or a folder that `inkloop run` has made",
    "info cube.toml": "cube.toml: is a scenario; `inkloop validate` describes it",
    "info full/notes.txt": "notes.txt: is not a readable FMU: |name an .fmu file, or export or copy it again",
    "export fmu LayerDepositoin": "there is no FMU 'LayerDepositoin' in |did you mean LayerDeposition?",
    "export fmu LayerDeposition --nx 0": "the grid is 0 x 9 cells; expected at least 1 x 1",
    "export fmu LayerDeposition --nx many": "2 argument --nx: is 'many'; expected a whole number",
    "export fmu LayerDeposition --fmi 4": "2 argument --fmi: invalid choice: '4' (choose from",
    "export fmu LayerDeposition --fmi 2 --nx 50000 --ny 50000": "as FMI 2 of 50000 x 50000 cells needs about |choose a",
    "export ssp cube.toml --fmi 3": "--fmi 3: SSP 1.0 takes FMI 2 only; add --ssp 2.0, or leave --fmi out",
    "export job missing.toml": "missing.toml: |No such file or directory; known: cube.toml",
    "export layers cube.toml --layers 5-2": "--layers 5-2: expected A-B within layers 1 to 3, for example 1-3",
    "identify full": "holds neither print.toml of a logged print nor result.nc of a run; name a folder that",
    "identify .": ".: holds neither print.toml of a logged print nor result.nc of a run; name a folder that `ink",
    "identify nope": "nope: is no folder, no .toml or .fmu file and no kind of printer; known: LayerDeposition, Supe",
    "score nope": "there is no controller 'nope'; write MODULE:CLASS, or a kind; known: |LayerMpc",
    "score nope:Class": "nope:Class: 1 error|No module named 'nope'; looked for modules in",
    "score LayerMcp": "there is no controller 'LayerMcp'; |did you mean LayerMpc?",
    "bench status cube.toml": "it names none. Set interface and channel of [bench] in the scenario, or configure pyt",
    "bench emulate cube.toml": "bench.interface and bench.channel are not set, |[bench]\n    interface = |or use --p",
    "bench emulate cube.toml --port 0 --fault explode": "--fault explode: kind is 'explode'; expected 'loss', ",
    "metrology full/map.csv": "the unit of its heights; give unit (--unit): |its pixels; give pixel_um (--pixel-um), ",
    "sweep cube.toml": "is a scenario; name it in a study file, which has title = |scenario = ",
    "metrology nope.tif": "nope.tif: cannot be read: No such file or directory",
    "geometry full/part.stl": "part.stl: holds no triangles; expected a closed surface",
    "geometry full/notes.txt": "notes.txt: has no row of numbers (lines read: 1); expected heights",
    "new cube": "cube.toml: |is there already and is not overwritten; choose another name",
    "new p --shape ball": "2 argument --shape: invalid choice: 'ball' (choose from 'combine', 'cuboid'",
    "export schema --out full/notes.txt/x.json": "x.json: its folder cannot be made: a file is in the way; name",
    "validate ended": "ended: |is the folder of a run of /a/cube.toml that has ended (done); `inkloop report ended` sh",
    "validate begun": "begun: |is the folder of a run of /a/cube.toml; `inkloop resume begun` continues it",
    "validate torn": "torn: |is the folder of a run that cannot be read; `inkloop info torn` says why",
    "run cube.toml --out ended": "that has ended (done); `inkloop report ended` shows it; name another --out, nothing",
    "run cube.toml --out begun": "`inkloop resume begun` continues it; name another --out, nothing is overwritten",
    "run cube.toml --out swept": "swept: is the folder of a study; `inkloop sweep STUDY --out swept --resume` con",
    **dict.fromkeys(
        ("info swept", "report swept", "resume swept", "validate swept", "sweep swept"),
        "is the folder of a study; `inkloop sweep STUDY --out swept --resume` continues it, or shows what it found",
    ),
    "validate swept/study.toml": "swept/study.toml: |is a study; `inkloop sweep swept/study.toml` prints it",
    "sweep begun": "begun: |is the folder of a run of /a/cube.toml; `inkloop resume begun` continues it",
    "reproduce lou": "2 argument PAPER: invalid choice: 'lou' (choose from 'lu'",
}
"""Command line -> pieces of the message, joined by |; an exit code other than 1 in front."""

ENCODINGS = {
    "Latin-1": (CUBOID.replace("Cuboid", "Höhe").encode("latin-1"), "line 1 is not UTF-8; byte 0xf6 is 'ö' in |save t"),
    "UTF-16": (CUBOID.encode("utf-16"), "the file is UTF-16; save it as UTF-8"),
    "byte order mark": (b"\xef\xbb\xbf" + CUBOID.replace("nx = 12", "nx = 0").encode(), "grid.nx is 0; expected"),
}
WARNINGS = {
    "height_um = 3e5": "0 about 39,474 layers high; run.layers_max ends |; check the heights of [part]",
    "height_um = 1e-6": "0 the part is 1.3e-07 of a layer high; |; check the heights of [part], and those of",
}


def replaced(old: str, new: str) -> bytes:
    assert old in CUBOID
    return CUBOID.replace(old, new, 1).encode()


CASES: list[tuple[str, bytes, str]] = [
    *((f"validate cube.toml # {name}", replaced(old, new), said) for name, (old, new, said) in SCENARIO_ERRORS.items()),
    *((f"validate cube.toml # {name}", content, said) for name, (content, said) in ENCODINGS.items()),
    *((f"validate cube.toml # {new}", replaced("height_um = 22.8", new), said) for new, said in WARNINGS.items()),
    *((words, CUBOID.encode(), said) for words, said in COMMANDS.items()),
]


@pytest.mark.parametrize(("line", "scenario", "message"), CASES, ids=[line for line, *_ in CASES])
def test_input_is_answered_with_place_finding_and_remedy(
    line: str,
    scenario: bytes,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cube.toml").write_bytes(scenario)
    (tmp_path / "full").mkdir()
    for name, content in (("notes.txt", "hello"), ("map.csv", "1 2\n3 4\n"), ("part.stl", "solid x\nendsolid x\n")):
        (tmp_path / "full" / name).write_text(content)
    record = {"schema_version": result.SCHEMA_VERSION, "scenario_file": "/a/cube.toml"}
    for name, run in (("ended", {**record, "stop_reason": "done"}), ("begun", {**record, "stop_reason": "running"})):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(json.dumps(run))
    for name, content in (("torn/run.json", "{"), ("swept/study.json", "{}"), ("swept/study.toml", 'scenario = "x"')):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    before = sorted(tmp_path.rglob("*"))
    code, pieces = (int(message[0]), message[2:]) if message[:1].isdigit() and message[1:2] == " " else (1, message)
    try:
        ended = main(shlex.split(line, comments=True))
    except SystemExit as end:
        ended = int(str(end.code))
    streams = capsys.readouterr()
    assert ended == code
    shown = streams.err if code else streams.out
    assert not [piece for piece in pieces.split("|") if piece not in shown], shown
    assert "Traceback" not in streams.err
    assert sorted(tmp_path.rglob("*")) == before


COMPONENTS = CUBOID[CUBOID.index("[components.") :]
RIG = '[components.controller]\nkind = "LayerMpc"\n[components.rig]\nkind = "hardware.mapped"\nmapping = "{}.toml"\n'
LAMP = '[components.lamp]\nkind = "Fmu"\nfile = "odd.fmu"\n[components.printer]'
READ = {
    "odd.toml": "validate odd.toml",
    "odd.ssp": "validate odd.ssp",
    "job.toml": "validate empty.ssp --job job.toml",
    "ink.toml": ("[grid]", '[ink]\nfile = "ink.toml"\n[grid]'),
    "odd.fmu": ("[components.printer]", LAMP),
    "other.fmu": "info other.fmu",
    "part.stl": "geometry part.stl --unit mm",
    "part.3mf": "geometry part.3mf",
    "part.png": "geometry part.png --unit um --pixel-um 5",
    "manifest.json": "geometry manifest.json",
    "map.npy": "metrology map.npy --unit um --pixel-um 5",
    "map.tif": "metrology map.tif --unit um --pixel-um 5",
    "map.x3p": "metrology map.x3p",
    "map.csv": "metrology map.csv --unit um --pixel-um 5",
    "mask.npy": "metrology flat.csv --unit um --pixel-um 5 --mask mask.npy",
    "rig.toml": (COMPONENTS, RIG.format("rig")),
    "rig.dbc": (COMPONENTS, RIG.format("bound")),
    "study.toml": "sweep study.toml",
    "run.json": "report .",
    "run/result.nc": "report run",
}
"""File -> command that reads it, or what of the cuboid names it."""


@pytest.mark.parametrize("found", ["a pipe", "a device", "a socket"])
@pytest.mark.parametrize("name", READ)
def test_what_is_no_file_is_not_read(
    name: str, found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Reading a pipe would wait for a writer, reading a device go on for ever."""
    monkeypatch.chdir(tmp_path)
    read, record = READ[name], {"schema_version": result.SCHEMA_VERSION, "stop_reason": "end"}
    (tmp_path / "cube.toml").write_bytes(CUBOID.encode() if isinstance(read, str) else replaced(*read))
    (tmp_path / "bound.toml").write_text('dbc = "rig.dbc"\n')
    (tmp_path / "flat.csv").write_text("1 2\n3 4\n")
    zipfile.ZipFile(tmp_path / "empty.ssp", "w").close()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text(json.dumps(record))
    if found == "a device":
        Path(name).symlink_to("/dev/zero")
    else:
        os.mknod(name, 0o600 | (stat.S_IFIFO if found == "a pipe" else stat.S_IFSOCK))
    assert main(shlex.split(read if isinstance(read, str) else "validate cube.toml")) == 1
    error = " ".join(capsys.readouterr().err.split())
    assert f"it is {found}; name a file" in error
    assert name in error
    assert "Traceback" not in error
