"""Objects that tests compile are kept from run to run, and never stand for other contents."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from support import compiled
from support.places import ROOT


def test_no_test_replaces_a_function_of_subprocess_for_all() -> None:
    """A fixture that compiles meanwhile would get the replacement; name the module under test instead."""
    replaced = re.compile(r"setattr\(\s*(subprocess\b|\"subprocess\.)|\bsubprocess\.\w+ = |patch\(\"subprocess\.")
    found = [path for path in (ROOT / "tests").rglob("*.py") if replaced.search(path.read_text(encoding="utf-8"))]
    assert found == []


@pytest.mark.compiled
def test_object_is_kept_until_its_header_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "KEPT", tmp_path / "kept")
    header, source = tmp_path / "headers/answer.h", tmp_path / "answer.c"
    header.parent.mkdir()
    source.write_text('#include "answer.h"\nint answer(void) { return ANSWER; }\n')

    def made(answer: int) -> bytes:
        header.write_text(f"#define ANSWER {answer}\n")
        compiled._headers.cache_clear()
        compiled.compile_kept(source, tmp_path / "answer.o", (f"-I{header.parent}",), "gcc")
        return (tmp_path / "answer.o").read_bytes()

    first = made(1)
    monkeypatch.setattr(compiled, "run", lambda command: pytest.fail("compiled again"))
    assert made(1) == first
    monkeypatch.undo()
    monkeypatch.setattr(compiled, "KEPT", tmp_path / "kept")
    assert made(2) != first
