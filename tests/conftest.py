"""Marks by folder, the folder that the tests of a run share, and how properties are tried.

The examples of properties are the same in every run; `--hypothesis-profile=random`, of `make test-long`, draws others.
"""

from __future__ import annotations

import gc
import locale
import os
import shutil
import signal
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from support import compiled
from support.once_per_run import RUN_FOLDER

FOLDER = Path(__file__).parent
MARKS = {"system": ("system", "compiled"), "reference": ("system",), "unit/firmware": ("compiled",)}
"""Folder -> marks of all its tests, whole prints included; files elsewhere mark what compiles themselves."""

TEXTS = locale.setlocale(locale.LC_CTYPE)
"""Locale of the texts of files, as the process began."""
LONG_S = 4 * 3600
"""Limit of a test with the mark `long`; `timeout` in pyproject.toml is that of the others."""
CLOCKLESS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine fails no property."""
settings.register_profile("same", CLOCKLESS, derandomize=True)
settings.register_profile("random", CLOCKLESS, derandomize=False)  # Hypothesis sets it where CI is in the environment
settings.load_profile("same")


def pytest_configure(config: pytest.Config) -> None:
    """The process that starts the workers owns the folder of the run; Ctrl-C works in all that it starts.

    BLAS gets one thread: threads that wait for each other count as processor time. Temporary folders of inkloop lie in
    the folder of the run: each print looks there for abandoned ones, and a system's own folder can hold thousands.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # NumPy reads it when a worker loads it
    if RUN_FOLDER not in os.environ:
        folder = os.environ[RUN_FOLDER] = tempfile.mkdtemp(prefix="inkloop-tests-")
        config.add_cleanup(lambda: shutil.rmtree(folder))
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())  # `tmp_path` stays when the run has ended
        os.environ["TMPDIR"] = tempfile.tempdir = str(Path(folder, "temporary"))
        Path(folder, "temporary").mkdir()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # run by nohup or in the background of a script
        signal.signal(signal.SIGINT, signal.default_int_handler)  # programs that tests start and interrupt inherit it


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """Fail a test after which a native library has left the process another locale, and give that back."""
    if (found := locale.setlocale(locale.LC_CTYPE)) != TEXTS:
        locale.setlocale(locale.LC_CTYPE, TEXTS)
        pytest.fail(f"{item.nodeid} has changed the locale to {found}", pytrace=False)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Exclude collected items from garbage collection: the collector need not search 7,000 tests again and again.

    It comes after 20,000 new objects, not after 700: its passes took a twentieth of the processor time of a run.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000)
        gc.enable()


def pytest_unconfigure() -> None:
    """Pytest collects five times at the end, for the sake of what Python reports only then; once is enough."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        place = f"{item.path.relative_to(FOLDER).as_posix()}/"
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.timeout(LONG_S))
        for folder, marks in MARKS.items():
            if place.startswith(f"{folder}/"):
                for mark in marks:
                    item.add_marker(mark)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """A compiler that runs in a test without the mark is an error, so that `make check` stays free of compilers."""
    compiled.unmarked_test = "" if item.get_closest_marker("compiled") else item.nodeid
    return (yield)


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs leave their table only: drawing is half the work of a short run, and tests of its own look at pictures."""
    monkeypatch.setattr("inkloop.report.pictures.pictures", lambda runs: {})
