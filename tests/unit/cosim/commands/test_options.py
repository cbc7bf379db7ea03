"""Options of the command line: their defaults, how they are read, and that they arrive where they are used."""

from __future__ import annotations

import argparse
import errno
import json
import re
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
import shtab

from inkloop import cli
from inkloop.cli import main, parser
from inkloop.commands import options
from inkloop.errors import InkloopError, ScenarioError
from inkloop.files import toml_tables
from inkloop.scenario.file import Scenario
from inkloop.scenario.json_schema import keys_of

BLOCK = """
title = "a small block"
grid = { nx = 7, ny = 5 }
part = { shape = "cuboid", height_um = 15.2, size_x_um = 700.0, size_y_um = 500.0 }
[components.controller]
kind = "LayerMpc"
[components.printer]
kind = "LayerDeposition"
[components.profiler]
kind = "ProfileSensor"
"""


@pytest.fixture
def block(tmp_path: Path) -> Path:
    path = tmp_path / "block.toml"
    path.write_text(BLOCK, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("pairs", "found"),
    [
        (["seed=5", " seed = 6 "], {"seed": 6}),
        (["title=a=b"], {"title": "a=b"}),
        (["title=two words", "run.step_s=0.5"], {"title": "two words", "run.step_s": 0.5}),
        (["title=0,5 mm", "label='0,5'"], {"title": "0,5 mm", "label": "0,5"}),
        (["a.b=[1, 2]"], {"a.b": [1, 2]}),
    ],
)
def test_override_is_a_key_and_a_value(pairs: list[str], found: dict[str, object]) -> None:
    assert options.overrides_of(pairs, "it") == found


def options_of(of: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """Every option, those of subcommands included, with its command."""
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from options_of(below)
        else:
            yield of.prog, action


def test_default_of_an_option_is_the_one_that_its_help_names() -> None:
    found, named = {}, {}
    for command, option in options_of(parser()):
        words = re.search(r"default: ([^\s;,)]+)", option.help or "")
        if words and option.default is not None and not isinstance(option.default, bool):
            key, default = (command, *option.option_strings), option.default
            found[key] = ",".join(default) if isinstance(default, tuple) else str(default)
            named[key] = words[1]
    picture = ("inkloop compare", "--out")  # the default without the suffix of its first picture
    named[picture] = named[picture].removesuffix(".png")
    assert found == named
    assert found["inkloop identify", "--side"] == "32"


def test_every_override_that_is_none_is_named() -> None:
    with pytest.raises(ScenarioError) as raised:
        options.overrides_of(["seed", "a..b=1", "=1", ".a=1", "seed=1"], "it")
    assert [error.partition(": ")[0] for error in raised.value.errors] == [
        f"--set {pair}" for pair in ("seed", "a..b=1", "=1", ".a=1")
    ]


def test_override_with_a_decimal_comma_is_refused() -> None:
    with pytest.raises(ScenarioError) as raised:
        options.overrides_of(["a.b=0,5"], "it")
    advice = "a number has a point, no comma: 0.5; a list has brackets, a text quotes"
    assert raised.value.errors == (f"--set a.b=0,5: {advice}",)


@pytest.mark.parametrize(
    ("words", "formats"),
    [
        ([], ("png",)),
        (["--out", "both.svg"], ("svg",)),
        (["--out", "both"], ("png",)),
        (["--pictures", "pdf, png"], ("pdf", "png")),
        (["--no-pictures"], ()),
    ],
)
def test_formats_of_pictures_are_those_asked_for_or_of_the_suffix(words: list[str], formats: tuple[str, ...]) -> None:
    assert options.formats_of(parser().parse_args(["compare", "run", *words])) == formats


@pytest.mark.parametrize(
    ("chosen", "foreign", "isolated"),
    [(None, [], False), (None, ["a"], True), (True, [], True), (False, ["a"], False)],
)
def test_print_is_isolated_where_it_was_asked_or_an_fmu_is_foreign(
    chosen: bool | None, foreign: list[str], isolated: bool
) -> None:
    scenario: Any = SimpleNamespace(foreign_fmus=foreign)
    assert options.is_isolated(Namespace(isolate=chosen), scenario) is isolated


@pytest.mark.parametrize(
    ("line", "defaults"),
    [
        ("export fmu M", {"fmi": "3", "nx": 9, "ny": 9, "intervals": None, "fixed": False, "force": False}),
        ("export job s.toml", {"fmi": "2", "platforms": None}),
        ("export ssp s.toml", {"fmi": None, "ssp": "1.0", "to": "ssp"}),
        ("export surface r --format stl", {"map": "printed", "layer": None, "part": False, "fill_um": None}),
        ("export layers r", {"format": "tiff", "passes": False, "drop_levels": None, "layers": None}),
        ("run s.toml", {"isolate": None, "no_compare": False, "pictures": ("png",), "overrides": []}),
        ("run s.toml --on-part --set seed=1", {"overrides": ["bench.on_part=true", "seed=1"]}),
        ("metrology m", {"filter_order": 1, "f_operation": "plane", "profile": None, "missing": 0.2}),
        ("metrology m --profile", {"profile": "x"}),
        ("watch r", {"port": 8050}),
        ("new n", {"shape": "cylinder", "list": False}),
    ],
)
def test_options_have_the_defaults_that_their_help_states(line: str, defaults: dict[str, object]) -> None:
    found = vars(parser().parse_args(line.split()))
    assert {name: found[name] for name in defaults} == defaults


def test_every_option_of_an_exported_fmu_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    export = Mock(return_value=Path("it.fmu"))
    monkeypatch.setattr("inkloop.fmu_writer.export.export_fmu", export)
    numbers = ["--nx", "4", "--ny", "5", "--intervals", "3"]
    assert main(["export", "fmu", "M", "--fmi", "2", *numbers, "--fixed", "--force", "--platforms", "a, b"]) == 0
    chosen = {"fmi": "2", "nx": 4, "ny": 5, "intervals": 3, "fixed": True, "force": True, "platforms": ("a", "b")}
    export.assert_called_once_with("M", out=Path("M.fmu"), **chosen)
    assert main(["export", "fmu", "M", "--out", "other.fmu"]) == 0
    assert export.call_args.kwargs["out"] == Path("other.fmu")


@pytest.mark.parametrize(("words", "give_up"), [(["clear"], False), (["clear", "--give-up"], True), (["home"], False)])
def test_open_layer_is_given_up_where_it_is_asked(
    words: list[str], give_up: bool, block: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    act = Mock(return_value=0)
    monkeypatch.setattr("inkloop.bench.commands.act", act)
    assert main(["bench", words[0], str(block), *words[1:]]) == 0
    assert act.call_args.args[1] == words[0]
    assert act.call_args.kwargs == {"give_up": give_up}


def test_overrides_of_a_run_on_a_bench_arrive(block: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found: list[tuple[Path, dict[str, object]]] = []

    def scenario_of_run(run: Path, overrides: dict[str, object]) -> Any:
        found.append((run, overrides))
        return nullcontext(Scenario.load(block))

    act, replay = Mock(return_value=4), Mock(return_value=5)
    monkeypatch.setattr("inkloop.printing.run.scenario_of_run", scenario_of_run)
    monkeypatch.setattr("inkloop.bench.commands.act", act)
    monkeypatch.setattr("inkloop.bench.replay.replay", replay)
    given = ["--set", "bench.channel=can1"]
    assert main(["bench", "status", str(tmp_path), *given]) == 4
    assert found == [(tmp_path, {"bench.channel": "can1"})]
    assert main(["bench", "replay", str(tmp_path), *given]) == 5
    assert replay.call_args.args[1] == {"bench.channel": "can1"}


def test_doctor_of_a_scenario_that_cannot_be_read_has_an_exit_code_of_its_own(tmp_path: Path) -> None:
    assert main(["bench", "doctor", str(tmp_path / "none.toml")]) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{folder}", "--channel", "z"], "is a run; leave --channel out"),
        (["{folder}", "--pixel-um", "5", "--unit", "um"], "is a run; leave --unit and --pixel-um out"),
        (["{folder}/block.toml", "--layer", "2", "--map", "printed"], "is a map; leave --layer and --map out"),
        (["{folder}/block.toml", "--map", "printed"], "is a map; leave --map out"),
    ],
)
def test_options_of_a_map_are_none_of_a_run(
    words: list[str], message: str, block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["metrology", *(word.format(folder=block.parent) for word in words)]) == 1
    assert message in capsys.readouterr().err


def test_valid_scenario_is_described_in_figures(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(block), "--json"]) == 0
    streams, scenario = capsys.readouterr(), Scenario.load(block)
    found, footprint = json.loads(streams.out), scenario.footprint
    printed = int(scenario.job().mask.sum())
    assert (found["cells"], found["printed_cells"], found["layers"]) == ([7, 5], printed, footprint.layers)
    assert found["processor_s"] == footprint.seconds
    assert (found["memory_bytes"], found["disk_bytes"]) == (footprint.memory, footprint.disk)
    assert footprint.memory != footprint.disk
    assert (found["errors"], found["warnings"]) == ([], [])
    assert found["components"] == ["controller", "printer", "profiler"]
    assert f"no errors; 7 x 5 cells, {printed} printed, components controller, printer, profiler; " in streams.err


@pytest.mark.parametrize(
    "option", [["--pitch-um", "5"], ["--unit", "mm"], ["--pixel-um", "5"], ["--count-scale", "1"], ["--channel", "z"],
               ["--rotate", "x=9"], ["--scale", "2"], ["--height-um", "9"]], ids=lambda words: words[0]
)  # fmt: skip
def test_option_of_a_part_is_none_of_a_scenario(
    option: list[str], block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["geometry", str(block), "--no-pictures", *option]) == 1
    assert f"{option[0]}: goes with the file of a part; leave it out, or name that file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyboardInterrupt(), 130, "interrupted\n"),
        (MemoryError(), 1, "inkloop: the memory is exhausted; take fewer cells or threads, or close other programs\n"),
        (OSError(errno.ENOSPC, "no space"), 1, "a file: the disk is full\n"),
        (OSError(errno.EACCES, "denied", "it.fmu"), 1, "it.fmu: denied\n"),
        (InkloopError("no"), 1, "no\n"),
    ],
)
def test_error_of_a_command_is_told_with_its_file_and_an_exit_code(
    error: BaseException, code: int, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("inkloop.fmu_writer.export.export_fmu", Mock(side_effect=error))
    assert main(["export", "fmu", "M"]) == code
    assert capsys.readouterr().err == said


def test_errors_of_a_scenario_are_one_by_one_in_json(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(block), "--json", "--set", "grid.nx=0", "--set", "grid.ny=0"]) == 1
    assert [error.partition(";")[0] for error in json.loads(capsys.readouterr().out)["errors"]] == [
        "grid.nx is 0",
        "grid.ny is 0",
    ]


def test_original_error_is_shown_with_its_calls(capsys: pytest.CaptureFixture[str]) -> None:
    shown = Namespace(json=False, traceback=True)
    options.show_error(InkloopError("it: denied"), shown, PermissionError(errno.EACCES, "denied", "it"))
    assert capsys.readouterr().err == "PermissionError: [Errno 13] denied: 'it'\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "s.toml", "--ouut=a/long/path"], "unknown arguments: --ouut=a/long/path; did you mean --out?"),
        (["run", "s.toml", "--ouut", "x", "--sett"], "did you mean --out or --set?"),
        (["run", "s.toml", "--zzz"], "unknown arguments: --zzz\n"),
        (["geometry", "a.stl", "--height", "9"], "unknown arguments: --height 9; did you mean --height-um?"),
        (["metrology", "r", "--s-f=9"], "unknown arguments: --s-f=9; did you mean --s-filter-um?"),
        (
            ["export", "LayerDeposition"],
            "there is no command 'LayerDeposition'; `inkloop export` is now `inkloop export fmu`",
        ),
        (["report", "r", "--html", "--pdf"], "argument --pdf: not allowed with argument --html"),
        (["--verison"], "inkloop: error: the following arguments are required: COMMAND"),
        (["geometry", "a.stl", "--scale", "0,5"], "is '0,5'; a number has a point, no comma: 0.5"),
        (["export", "fmu", "M", "--nx", "1,000"], "is '1,000'; expected a whole number"),
        (["export", "layer"], "there is no command 'layer'; did you mean layers?"),
    ],
)
def test_wrong_words_are_answered_with_the_nearest(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(words)
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["--seed", "3"], "--set seed=3"),
        (["--layers=3"], "--set run.layers_max=3"),
        (["--title", "a b"], "--set 'title=a b'"),
        (["--noise-std", "1", "--h1"], "--set components.profiler.noise_std_um=1 or --set ink.a.h1_um=VALUE or"),
        (["--radios-um", "9"], "--set part.radius_um=9"),
        (["--ouut", "x", "--seed"], "--out or --set seed=VALUE"),
    ],
)
def test_option_that_is_a_key_of_the_scenario_is_answered_with_its_override(
    words: list[str], meant: str, block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["run", str(block), *words])
    assert f"; did you mean {meant}" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["resume", str(block), *words])  # which takes no keys
    assert "--set" not in capsys.readouterr().err


def test_every_key_of_a_component_can_be_overridden(block: Path) -> None:
    raw = toml_tables(BLOCK)
    keys = keys_of(raw)
    assert len(keys) == len(set(keys))
    assert {"seed", "run.layers_max", "part.radius_um", "components.printer.variation"} <= set(keys)
    assert {"components", "compare", "part"}.isdisjoint(keys)
    assert "components.controller.kind" in keys
    assert not [key for key in keys_of({"components": 3}) if key.startswith("components.")]


def test_paths_are_completed_to_files_or_folders() -> None:
    whole = parser()
    cli._mark_paths(whole)
    (commands,) = (action for action in whole._actions if action.dest == "command_name")
    found = {action.dest: getattr(action, "complete", None) for action in commands.choices["run"]._actions}  # type: ignore[index]
    assert (found["scenario"], found["out"], found["pictures"]) == (shtab.FILE, shtab.DIR, None)


def test_classes_of_a_job_stand_next_to_it(block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an .ssp, which lies elsewhere."""
    looked: list[Path] = []

    @contextmanager
    def classes_from(folder: Path) -> Iterator[None]:
        looked.append(folder)
        yield

    read = Mock()
    monkeypatch.setattr("inkloop.scenario.packaged.classes_from", classes_from)
    monkeypatch.setattr("inkloop.exchange.ssp.reading.scenario_of", read)
    other = tmp_path / "jobs" / "job.toml"
    for words, place in (([], tmp_path / "elsewhere"), (["--job", str(other)], other.parent)):
        system = tmp_path / "elsewhere" / "it.ssp"
        chosen = parser().parse_args(["validate", str(system), *words])
        with options.scenario_of(chosen):
            assert looked.pop() == place
        assert read.call_args.args == (system, {}, other if words else None)
    with options.scenario_of(parser().parse_args(["validate", str(block)])):
        assert looked == [tmp_path]


def test_isolated_print_has_the_folder_of_a_print(block: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Under the name of the scenario; its subprocess gets the words and that folder."""
    isolated = Mock(return_value=4)
    monkeypatch.setattr("inkloop.printing.isolation.run_isolated", isolated)
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(block), "--isolate"]) == 4
    folder = Path("runs/block")
    words = ["run", str(block), "--isolate", "--no-isolate", "--out", str(folder)]
    isolated.assert_called_once_with(words, folder, [])


def test_isolated_rest_of_a_print_is_not_isolated_again(
    block: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    isolated = Mock(return_value=4)
    monkeypatch.setattr("inkloop.printing.isolation.run_isolated", isolated)
    monkeypatch.setattr("inkloop.printing.run.scenario_of_run", lambda run: nullcontext(Scenario.load(block)))
    assert main(["resume", str(tmp_path), "--isolate"]) == 4
    isolated.assert_called_once_with(["resume", str(tmp_path), "--isolate", "--no-isolate"], tmp_path, [])


def test_table_of_a_report_comes_with_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("inkloop.report.run_report.write", lambda run, formats: f"table of {run.name} {formats}")
    monkeypatch.setattr("inkloop.report.run_report.record", lambda run: {"folder": run.name})
    assert main(["report", str(tmp_path / "it"), "--json", "--no-pictures"]) == 0
    streams = capsys.readouterr()
    assert json.loads(streams.out) == {"folder": "it"}
    assert "table of it ()" in streams.err


def test_every_run_is_compared_in_the_picture_that_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    compare = Mock(return_value=("table", [], []))
    monkeypatch.setattr("inkloop.report.run_report.compare", compare)
    assert main(["compare", "a", "b", "c", "--out", "all.svg"]) == 0
    compare.assert_called_once_with([Path("a"), Path("b"), Path("c")], Path("all.svg"), ("svg",))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["info", "{folder}/none.toml"], "none.toml: is not there; name an .fmu file"),
        (["info", "{folder}/block.toml"], "block.toml: is a scenario; `inkloop validate` describes it"),
        (["info"], "info: name an FMU or a run, or --devices"),
        (["validate", "{folder}/block.toml", "--job", "x.toml"], "--job x.toml: --job goes with an .ssp; leave it out"),
    ],
)
def test_word_that_a_command_cannot_take_is_answered(
    words: list[str], message: str, block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([word.format(folder=block.parent) for word in words]) == 1
    assert message in capsys.readouterr().err


def test_warning_is_told_and_listed(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(block), "--json", "--set", "part.height_um=2.0"]) == 0
    streams = capsys.readouterr()
    (warning,) = json.loads(streams.out)["warnings"]
    assert warning.startswith("the part is 0.26 of a layer high")
    assert f"{block}: warning: {warning}" in streams.err


def test_layer_that_a_person_has_seen_is_told_to_the_rest_of_a_print(
    block: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    resume = Mock(return_value=4)
    monkeypatch.setattr("inkloop.printing.run.resume", resume)
    monkeypatch.setattr("inkloop.printing.run.scenario_of_run", lambda run: nullcontext(Scenario.load(block)))
    assert main(["resume", str(tmp_path), "--layer-is", "blank", "--no-pictures"]) == 4
    assert resume.call_args.args[1] == tmp_path
    assert resume.call_args.kwargs == {"pictures": (), "layer_is": "blank"}


def test_part_of_a_scenario_is_described_with_the_classes_next_to_it(tmp_path: Path, block: Path) -> None:
    (tmp_path / "next_to_it.py").write_text("""class Rule:
    def __init__(self, job):
        pass

    def pattern(self, height, layer):
        return (0 * height).astype(int)
""")
    block.write_text(BLOCK.replace('"LayerMpc"', '"next_to_it:Rule"'), encoding="utf-8")
    assert main(["geometry", str(block), "--no-pictures"]) == 0


@pytest.mark.parametrize("turn", ["=5", "w=5", "x", "x=a", "xy=5"])
def test_turn_is_an_axis_and_an_angle(turn: str) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(["geometry", "a.stl", "--rotate", turn])
    assert parser().parse_args(["geometry", "a.stl", "--rotate", "y=-5"]).rotate == [("y", -5.0)]


@pytest.mark.parametrize(
    ("words", "out", "chosen"),
    [
        ([], None, {"compare": True, "pictures": ("png",)}),
        (["--no-compare", "--pictures", "svg", "--out", "x"], Path("x"), {"compare": False, "pictures": ("svg",)}),
    ],
)
def test_choices_of_a_print_arrive(
    words: list[str], out: Path | None, chosen: dict[str, object], block: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Mock(return_value=4)
    monkeypatch.setattr("inkloop.printing.run.run", run)
    assert main(["run", str(block), *words]) == 4
    scenario, place, _ = run.call_args.args
    assert (scenario.source, place, run.call_args.kwargs) == (str(block), out, chosen)
