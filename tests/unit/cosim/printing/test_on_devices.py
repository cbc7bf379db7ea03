"""Messages of devices during a print: on the screen and in the log of the run, and nowhere afterwards."""

from __future__ import annotations

import logging
import re
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop.component import DEVICE_LOGGER
from inkloop.printing.on_devices import LOG_FILE, live_words, local_port, log_devices

LOGGER = logging.getLogger(DEVICE_LOGGER)


@pytest.mark.parametrize("verbose", [False, True])
def test_warnings_are_shown_and_all_messages_where_asked_and_in_the_log(verbose: bool, tmp_path: Path) -> None:
    shown: list[tuple[str, str]] = []
    console: Any = SimpleNamespace(verbose=verbose, sentence=lambda *words: shown.append(words))
    before = LOGGER.level, list(LOGGER.handlers)
    with live_words(console, tmp_path):
        LOGGER.debug("frame")
        LOGGER.info("homed %d", 2)
        LOGGER.warning("late")
        LOGGER.error("lost\a")
    assert (LOGGER.level, LOGGER.handlers) == before
    LOGGER.error("afterwards")
    warnings = [("  late", "red"), ("  lost\a", "red")]
    assert shown == ([("  homed 2", "dim"), *warnings] if verbose else warnings)
    lines = (tmp_path / LOG_FILE).read_text(encoding="utf-8").splitlines()
    assert [re.sub(r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} ", "", line) for line in lines] == [
        "INFO homed 2",
        "WARNING late",
        r"ERROR lost\x07",
    ]


def test_without_a_folder_there_is_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    console: Any = SimpleNamespace(verbose=False, sentence=lambda *words: None)
    with live_words(console, None):
        LOGGER.warning("late")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("kinds", "logs"),
    [
        (("LayerMpc", "LayerDeposition"), False),
        (("LayerMpc", "MapFolder"), True),
        (("hardware.printer", "ProfileSensor"), True),
    ],
)
def test_prints_with_devices_or_files_of_a_profiler_are_logged(kinds: tuple[str, ...], logs: bool) -> None:
    components = {kind: SimpleNamespace(kind=kind) for kind in kinds}
    tables = SimpleNamespace(components=components, bench=SimpleNamespace(channel="can0"))
    scenario: Any = SimpleNamespace(tables=tables)
    console: Any = SimpleNamespace(verbose=False)
    assert isinstance(log_devices(scenario, console, Path()), nullcontext) is not logs


@pytest.mark.parametrize("channel", ["socket://127x0.0.1:28550", "socket://127.0.0.1:28550/x", 28550, ""])
def test_channel_that_only_looks_like_a_port_of_this_machine_is_none(channel: str | int) -> None:
    assert local_port(channel) is None
