"""The master of a mapped rig is killed, or a wait runs out of time, anywhere in a layer: no layer is jetted twice.

The rig has no memory that the master can ask: what it jetted is counted from its own log.
"""

from __future__ import annotations

import re
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from inkloop.results.result import Result
from inkloop_hardware.emulated_bench import EmulatedBench
from support.benches import foreign_rig
from support.benches.bench_run import COMMAND
from support.long_proofs import rest_is_long

LAYERS = 4
PATIENCE_S = 600.0


@contextmanager
def rig(folder: Path, mapping: str = foreign_rig.MAPPING, layers: int = LAYERS) -> Iterator[Path]:
    """A rig on a wire, and a scenario that prints on it; its log is rig.log in `folder`."""
    with EmulatedBench({"nx": 6, "ny": 5}) as wire, foreign_rig.running(wire.channel, f"log={folder / 'rig.log'}"):
        (folder / "rig.dbc").write_text(foreign_rig.DBC)
        (folder / "rig.toml").write_text(mapping)
        text = foreign_rig.SCENARIO.replace("CHANNEL", wire.channel).replace("layers_max = 2", f"layers_max = {layers}")
        (folder / "part.toml").write_text(text.replace("layers = 2", f"layers = {layers}"))
        yield folder / "part.toml"


def noted(folder: Path) -> list[tuple[str, int]]:
    """The log of the rig: (thing done, layer)."""
    log = folder / "rig.log"
    lines = log.read_text().split("\n")[:-1] if log.exists() else []
    return [(what, int(layer)) for what, layer in map(str.split, lines)]


def master(*words: str | Path) -> subprocess.Popen[str]:
    command = [*COMMAND, *map(str, words), "--no-pictures"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def killed_after(folder: Path, events: int, process: subprocess.Popen[str]) -> str | None:
    """Kills the master when the rig has done so many more things; its words if it ended before, None if not."""
    wanted, until = len(noted(folder)) + events, time.monotonic() + PATIENCE_S
    while process.poll() is None and len(noted(folder)) < wanted and time.monotonic() < until:
        time.sleep(0.002)
    was_running = process.poll() is None
    process.kill()
    words, _ = process.communicate()
    return None if was_running else words


def looked_at(folder: Path, words: str) -> str:
    """Answer of a person about the layer in the words, once the rig has ended a layer that it has begun."""
    asked = re.search(r"layer (\d+) was begun and not finished", words)
    assert asked, words
    layer = int(asked[1])
    until = time.monotonic() + PATIENCE_S
    while ("start", layer) in noted(folder) and ("done", layer) not in noted(folder) and time.monotonic() < until:
        time.sleep(0.02)
    return "printed" if ("done", layer) in noted(folder) else "blank"


def starts(folder: Path) -> Counter[int]:
    """Number of starts of each layer."""
    return Counter(layer for what, layer in noted(folder) if what == "start")


def assert_printed_once(folder: Path, run: Path, layers: int = LAYERS) -> None:
    assert starts(folder) == dict.fromkeys(range(1, layers + 1), 1)
    result = Result.load(run).dataset
    heights = foreign_rig.DROPLET_UM * 1e-6 * np.cumsum(result.pattern.values != 0, axis=0)
    np.testing.assert_allclose(result.measured_height[-1], np.where(result.valid[-1], heights[-1], 0.0), atol=1e-12)


@pytest.mark.parametrize(("lives", "layers"), rest_is_long([(2, LAYERS), (2, 32)], 1))
def test_killed_master_prints_every_layer_once(lives: int, layers: int, tmp_path: Path) -> None:
    """Each life ends after 1 to `lives` more things that the rig did, so that all places of a layer have their turn."""
    run, asked, kills = tmp_path / "run", 0, 0
    with rig(tmp_path, layers=layers) as part:
        words = killed_after(tmp_path, 1, master("run", part, "--out", run))
        while words is None or "was begun and not finished" in words:
            answer = [] if words is None else ["--layer-is", looked_at(tmp_path, words)]
            asked, kills = asked + (words is not None), kills + (words is None)
            words = killed_after(tmp_path, 1 + kills % lives, master("resume", run, *answer))
            assert max(starts(tmp_path).values(), default=0) <= 1, "a layer was started twice"
        assert "layers" in words or "table" in words, words
    assert kills >= (2 if layers == LAYERS else 60)
    assert asked >= 1, "no kill fell into a layer"
    print(f"{kills} kills, {asked} layers asked about")
    assert_printed_once(tmp_path, run, layers)


def test_wait_that_ran_out_of_time_asks_before_anything_is_sent_again(tmp_path: Path) -> None:
    short = foreign_rig.MAPPING.replace('signal = "LayersDone"\nexpected = "{layer}"\nlimit_s = 10.0',
                                        'signal = "LayersDone"\nexpected = "{layer}"\nlimit_s = 0.001')  # fmt: skip
    run = tmp_path / "run"
    with rig(tmp_path, short) as part:
        assert "LayersDone was not 1" in master("run", part, "--out", run).communicate()[0]
        (tmp_path / "rig.toml").write_text(foreign_rig.MAPPING)
        sent = len([one for one in noted(tmp_path) if one[0] != "done"])
        words = master("resume", run).communicate()[0]
        assert "layer 1 was begun and not finished: the last step begun is 2 of 4 (send PlcCommand)" in words
        assert len([one for one in noted(tmp_path) if one[0] != "done"]) == sent
        words = master("resume", run, "--layer-is", looked_at(tmp_path, words)).communicate()[0]
        words = master("resume", run, "--layer-is", "printed").communicate()[0]
        assert "the run is finished" in words
    assert_printed_once(tmp_path, run)


def test_second_run_on_the_channel_of_a_print_is_refused(tmp_path: Path) -> None:
    with rig(tmp_path, layers=1000) as part:
        first = master("run", part, "--out", tmp_path / "run")
        until = time.monotonic() + PATIENCE_S
        while not starts(tmp_path) and time.monotonic() < until:
            time.sleep(0.01)
        words = master("run", part, "--out", tmp_path / "second").communicate()[0]
        first.kill()
        assert f"another inkloop prints there (process {first.pid} since" in words, first.communicate()[0]
        assert max(starts(tmp_path).values()) == 1
