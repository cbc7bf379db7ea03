"""Commands that need no picture, table of results or optimizer do not load the libraries for them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from inkloop.fmu_writer.export import find_fmu
from support.places import SCENARIOS
from support.prints import quick_cuboid

HEAVY = ("matplotlib", "scipy", "xarray", "pandas", "casadi", "plotly")
CODE = """
import json, sys
from inkloop.cli import main
report, commands = sys.argv[1], json.loads(sys.argv[2])
found = []
for words in commands:
    try:
        code = main(words)
    except SystemExit as end:
        code = end.code
    found.append([code, sorted({name.partition(".")[0] for name in sys.modules})])
open(report, "w").write(json.dumps(found))
"""


def loaded(folder: Path, *commands: tuple[str, ...]) -> list[tuple[int, set[str]]]:
    """Exit code of each command in one process, and the packages that are loaded after it."""
    report = folder / "modules.json"
    run = [sys.executable, "-c", CODE, str(report), json.dumps(commands)]
    subprocess.run(run, cwd=folder, check=True, capture_output=True)
    return [(int(code), set(packages)) for code, packages in json.loads(report.read_text())]


LIGHTEST = (("--version",), ("--help",))
LIGHT = (
    ("run", "--help"),
    ("new", "mine"),
    ("export", "schema"),
    ("validate", str(SCENARIOS / "cylinder.toml")),
    ("info", str(find_fmu("LayerDeposition"))),
    ("export", "fmu", "LayerDeposition"),
)


def test_light_commands_load_no_heavy_library_and_version_and_help_none_at_all(tmp_path: Path) -> None:
    found = loaded(tmp_path, *LIGHTEST, *LIGHT)
    for words, (code, packages) in zip((*LIGHTEST, *LIGHT), found, strict=True):
        assert (words, code, packages & {*HEAVY}) == (words, 0, set())
    for _, packages in found[: len(LIGHTEST)]:
        assert not packages & {"numpy", "pydantic", "tomlkit", "fmpy", "rich", "shtab"}


def test_run_without_pictures_draws_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    words = ("run", str(quick_cuboid()), "--out", str(folder), "--no-compare", "--no-pictures")
    ((code, packages),) = loaded(tmp_path, words)
    assert code == 0
    assert "xarray" in packages
    assert not packages & {"matplotlib", "pint"}
    assert (folder / "summary.txt").is_file()
    assert not list(folder.glob("*.png"))


def test_layer_mpc_needs_casadi_only_for_its_engines() -> None:
    code = (
        "import sys; from inkloop.testing import job; from inkloop_controller import LayerMpc; LayerMpc(job()); "
        "print('casadi' in sys.modules); LayerMpc(job(), relaxation='slp'); print('casadi' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "True"]


def test_engine_that_does_not_suit_the_horizon_is_refused_without_casadi() -> None:
    code = (
        "import sys; sys.modules['casadi'] = None; from inkloop.cli import main; "
        "sys.exit(main(['validate', 'casadi', '--set', 'components.controller.relaxation=highs']))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "components.controller.relaxation is 'highs' with horizon 2, alpha 0.8" in run.stdout + run.stderr
    assert "set these, or relaxation = 'slp'" in run.stdout + run.stderr
    assert "Traceback" not in run.stderr
