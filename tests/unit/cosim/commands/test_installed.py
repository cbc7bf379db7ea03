"""Commands of other packages, by a made-up distribution on the path of Python."""

from __future__ import annotations

from pathlib import Path

import pytest

from inkloop.cli import main

COMMAND = '''"""`inkloop weigh`."""


def add_parser(commands):
    parser = commands.add_parser("weigh", help="weigh a part")
    parser.add_argument("grams", type=float, metavar="G")
    return parser


def run(options):
    print(f"{options.grams:g} g")
    return 0
'''


@pytest.fixture
def other_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A distribution with the command `weigh`, one that cannot be loaded, and one under a name of inkloop."""
    (tmp_path / "balance.py").write_text(COMMAND, encoding="utf-8")
    metadata = tmp_path / "balance-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: balance\nVersion: 1.0\n", encoding="utf-8")
    points = "weigh = balance\ntare = balance.missing\nvalidate = balance\n"
    (metadata / "entry_points.txt").write_text(f"[inkloop.commands]\n{points}", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def shown(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of a command line."""
    try:
        code = main(words)
    except SystemExit as end:
        code = int(end.code or 0)
    return code, *capsys.readouterr()


@pytest.mark.usefixtures("other_package")
def test_package_adds_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert shown(["weigh", "2.50"], capsys) == (0, "2.5 g\n", "")
    code, _, errors = shown(["weigh", "heavy"], capsys)
    assert (code, "argument G: is 'heavy'; expected a number" in errors) == (2, True)


@pytest.mark.usefixtures("other_package")
def test_help_lists_the_commands_of_packages_and_names_one_that_cannot_be_loaded(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, output, errors = shown(["--help"], capsys)
    assert code == 0
    assert "weigh a part" in output
    assert "tare" not in output
    assert "the command tare of balance cannot be loaded: ModuleNotFoundError" in errors
    code, _, errors = shown(["tare", "--any"], capsys)
    assert (code, "the command tare of balance cannot be loaded" in errors) == (2, True)


@pytest.mark.usefixtures("other_package")
def test_no_package_replaces_a_command_of_inkloop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, errors = shown(["validate", str(tmp_path / "absent.toml")], capsys)
    assert (code, "absent.toml" in errors) == (1, True)


@pytest.mark.usefixtures("other_package")
def test_own_commands_look_for_no_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("inkloop.cli.entry_points", None)
    assert shown(["validate", str(tmp_path / "absent.toml")], capsys)[0] == 1
    assert shown(["--version"], capsys)[0] == 0
    with pytest.raises(TypeError):
        main(["weigh", "1"])
