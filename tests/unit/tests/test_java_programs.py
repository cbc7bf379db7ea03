"""Jars of Maven Central are taken whole and only where they are the expected ones."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from support.masters import java_programs
from support.masters.java_programs import Jar, JavaProgram


@pytest.fixture
def central(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Maven Central of two files in a folder, and an empty folder to keep them in."""
    folder = tmp_path / "central"
    folder.mkdir()
    for name in ("one.jar", "two.jar"):
        (folder / name).write_text(name)
    monkeypatch.setattr(java_programs, "CENTRAL", folder.as_uri())
    monkeypatch.setattr(java_programs, "KEPT", tmp_path / "kept")
    return folder


def program(second: str) -> JavaProgram:
    jars = [Jar(name, hashlib.sha256(text.encode()).hexdigest(), name) for name, text in
            (("one.jar", "one.jar"), ("two.jar", second))]  # fmt: skip
    return JavaProgram("it", "1.0", jars)


def test_expected_jars_are_kept(central: Path) -> None:
    it = program("two.jar")
    assert "make peers" in it.reason_it_is_absent() or "java is not installed" in it.reason_it_is_absent()
    it.fetch()
    assert sorted(file.name for file in it.folder.iterdir()) == ["one.jar", "two.jar"]
    it.fetch()  # there already: nothing to do


def test_other_content_is_refused_and_nothing_is_kept(central: Path) -> None:
    it = program("what was there when the sum was taken")
    with pytest.raises(OSError, match=r"two\.jar: SHA-256 is [0-9a-f]{64}; expected [0-9a-f]{64}"):
        it.fetch()
    assert not it.folder.exists()
