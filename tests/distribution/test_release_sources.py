"""Inputs of a release: the time of its files, the environment of its build, and its requirements."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import pytest
from tools.release import requirements, sources
from tools.release.requirements import closure

from inkloop.errors import InkloopError

PACKAGES = {
    "a": ["B>=1", "c; extra == 'fast'", "d; python_version < '3'"],
    "b": ["e[fast]"],
    "e": ["a", "f; extra == 'fast'"],
    "f": [],
}


def test_files_carry_the_time_that_is_named_or_that_of_the_last_commit(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert sources.source_epoch(tmp_path) == 1700000000
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "-5")
    with pytest.raises(InkloopError, match="SOURCE_DATE_EPOCH is '-5'; expected a whole number of seconds"):
        sources.source_epoch(tmp_path)
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    with pytest.raises(InkloopError, match="has no commit whose time the files could carry; set SOURCE_DATE_EPOCH"):
        sources.source_epoch(tmp_path)
    named = ["-c", "user.name=n", "-c", "user.email=e", "commit", "-q", "--allow-empty", "-m", "x"]
    times = {"GIT_COMMITTER_DATE": "1600000000 +0000", "GIT_AUTHOR_DATE": "1500000000 +0000"}
    for words in (["init", "-q"], named):
        subprocess.run(["git", *words], cwd=tmp_path, check=True, env={**os.environ, **times})
    assert sources.source_epoch(tmp_path) == 1600000000


def test_build_sees_no_setting_that_would_change_its_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in (*sources.FOREIGN, "KEPT"):
        monkeypatch.setenv(name, "from outside")
    code = "import json, os; json.dump(dict(os.environ), open('seen', 'w'))"
    sources.run([sys.executable, "-c", code], tmp_path, {"OWN": "1"})
    seen = json.loads((tmp_path / "seen").read_text())
    foreign = {
        "CC",
        "CFLAGS",
        "CPPFLAGS",
        "LDFLAGS",
        "CMAKE_ARGS",
        "CMAKE_GENERATOR",
        "SKBUILD_CMAKE_ARGS",
        "PYTHONPATH",
    }
    assert not foreign & set(seen)
    assert (seen["KEPT"], seen["OWN"]) == ("from outside", "1")
    assert seen["PATH"].split(os.pathsep)[0] == str(Path(sys.executable).parent)


def test_end_of_a_build_that_fails_is_in_the_message(tmp_path: Path) -> None:
    code = "print('\\n'.join(map(str, range(100)))); import sys; sys.exit('worse')"
    with pytest.raises(InkloopError) as caught:
        sources.run([sys.executable, "-c", code], tmp_path, {})
    first, *lines = str(caught.value).splitlines()
    assert first == f"{Path(sys.executable).name} ended with 1:"
    assert lines == [*map(str, range(61, 100)), "worse"]


def test_what_is_required_is_found_through_extras_and_markers(monkeypatch: pytest.MonkeyPatch) -> None:
    def distribution(name: str) -> SimpleNamespace:
        if name.lower() not in PACKAGES:
            raise PackageNotFoundError(name)
        return SimpleNamespace(requires=PACKAGES[name.lower()])

    monkeypatch.setattr(requirements, "distribution", distribution)
    found, needs = closure(["a"])
    assert list(found) == ["a", "b", "e", "f"]
    assert needs == {"": {"a"}, "a": {"b"}, "b": {"e"}, "e": {"a", "f"}, "f": set()}
    assert list(closure(["a"], transitive=False)[0]) == ["a"]
    with pytest.raises(InkloopError, match=r"inkloop requires c, which this environment lacks: make \.venv/developer"):
        closure(["a[fast]"])
