"""Endings of a print in a subprocess: exit codes of the command are passed on, anything else was a crash."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from inkloop.errors import ComponentError
from inkloop.printing import advice as advice_module
from inkloop.printing import isolation
from inkloop.printing.isolation import run_isolated
from inkloop.results.result import Result


def ended(code: int, folder: Path, monkeypatch: pytest.MonkeyPatch, foreign: tuple[str, ...] = ()) -> int:
    """The exit code of the subprocess, which is not started, as the command returns it."""
    monkeypatch.setattr(isolation, "subprocess", SimpleNamespace(call=lambda *_, **__: code))
    return run_isolated(["run", "it.toml"], folder, foreign)


@pytest.mark.parametrize(("code", "passed"), [*((code, code) for code in (0, 1, 2, 4, 130)), (-2, 130)])
def test_exit_code_of_the_command_is_passed_on(
    code: int, passed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ended(code, tmp_path, monkeypatch) == passed


@pytest.mark.parametrize(
    ("code", "name"),
    [(-11, "SIGSEGV"), (-6, "SIGABRT"), (-99, "signal 99"), (3, "exit code 0x3"), (0xC0000005, "exit code 0xc0000005")],
)
def test_other_ending_is_a_crash_with_its_name(
    code: int, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ComponentError) as raised:
        ended(code, tmp_path, monkeypatch)
    assert str(raised.value).splitlines()[0] == (
        f"the print was ended by {name}: native code crashed, of a component or a library; nothing was printed yet; "
        "fix the cause, then run it again"
    )
    with pytest.raises(ComponentError, match=r"crashed, most likely of components\.a or components\.b; nothing"):
        ended(code, tmp_path, monkeypatch, ("components.a", "components.b"))


def test_print_that_is_still_recorded_as_running_did_not_end_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error of the command stands alone."""
    Result.begin(tmp_path, "", {})
    assert ended(1, tmp_path, monkeypatch) == 1
    with pytest.raises(ComponentError) as raised:
        ended(0, tmp_path, monkeypatch)
    assert (
        str(raised.value)
        .splitlines()[0]
        .endswith(f"no layer was finished; fix the cause, then continue with `inkloop resume {tmp_path}`")
    )


@pytest.mark.parametrize(
    ("refusal", "advice"),
    [
        (None, "fix the cause, then continue with `inkloop resume {}`"),
        ("printer has no save", "the run cannot be resumed: printer has no save"),
    ],
)
def test_layers_that_a_crash_left_are_counted_from_the_start_surface(
    refusal: str | None, advice: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Result.begin(tmp_path, "", {})
    kept = SimpleNamespace(last=lambda place: SimpleNamespace(layer=7, refusal=refusal))
    monkeypatch.setattr(advice_module, "checkpoint", kept)
    with pytest.raises(ComponentError) as raised:
        ended(-11, tmp_path, monkeypatch)
    told = str(raised.value).splitlines()[0]
    assert told.endswith(f"; layers 0 to 7 are in {tmp_path}; {advice.format(tmp_path)}")


def test_second_ctrl_c_takes_the_advice_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*_: object, **__: object) -> int:
        raise KeyboardInterrupt

    Result.begin(tmp_path, "", {})
    monkeypatch.setattr(isolation, "subprocess", SimpleNamespace(call=pressed))
    with pytest.raises(KeyboardInterrupt) as raised:
        run_isolated(["run", "it.toml"], tmp_path)
    assert raised.value.__notes__ == [f"no layer was finished; continue with `inkloop resume {tmp_path}`"]
