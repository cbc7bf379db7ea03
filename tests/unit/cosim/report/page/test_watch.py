"""The live page: what it is sent while a part is printed, to whom, and that the print does not notice."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.printing.print import Print
from inkloop.printing.run import origin_of, print_part
from inkloop.printing.so_far import RunFolder, feed_of, state_of
from inkloop.report.page import page, server
from inkloop.report.page.devices import devices
from inkloop.report.page.feed import Feed
from inkloop.report.page.maps import FINAL_CELLS
from inkloop.results.recorder import LayerRow
from inkloop.results.result import RUN_FILE, SCHEMA_VERSION, Result
from inkloop.scenario.file import Scenario
from support.once_per_run import once
from support.pages import heights_of, unfinished, unpacked
from support.prints import quick_cuboid

EVIL = "evil.example"
LINES_MAX = 60
"""Of a stream of events until the layer has come; an idle server sends two in fifteen seconds."""


class Still:
    """A source whose runs a test changes; `readings` counts how often they were read."""

    def __init__(self, result: Result) -> None:
        self.result, self.layers, self.readings = result, 0, 0

    def stamps(self) -> dict[Path, object]:
        return {Path("layers"): self.layers}

    def runs(self) -> dict[str, Result]:
        self.readings += 1
        shown = self.result.dataset.isel(layer=slice(self.layers + 1))
        return {"closed loop": Result(shown, self.result.run)}


def printed() -> Result:
    """Six layers of the cuboid."""
    return Result.load(once(_print_six))


def _print_six(folder: Path) -> None:
    print_part(Scenario.load(quick_cuboid(), {"run.layers_max": 6})).save(folder)


def feed_of_six(folder: Path, layers: int = 0) -> tuple[Feed, Still]:
    source = Still(printed())
    source.layers = layers
    return Feed(source, lambda: "", folder / "bench.log", 6), source


def test_page_gets_the_layers_that_it_does_not_have_whatever_it_missed(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 1)
    assert feed.refresh()
    assert not feed.refresh()
    assert source.readings == 1
    first = feed.content()
    assert heights_of(first["runs"][0]).shape[0] == 2
    for source.layers in (2, 3, 5):
        assert feed.refresh()
    later = feed.content(first["epoch"], [2])["runs"][0]["layers"]
    assert later["first"] == 1  # which may have been scanned since
    steps = np.cumsum(unpacked(later["heights"]).astype(np.int64), axis=0)
    before = heights_of(first["runs"][0])[0]
    expected = printed().dataset.height.values[1:6] * 1e6
    assert np.abs(before + steps * 0.01 - expected).max() <= 0.005 * (1 + 1e-9)
    assert heights_of(feed.content("", [2])["runs"][0]).shape[0] == 6  # of another epoch: all of them
    assert feed.content(first["epoch"], [10**8])["runs"][0]["layers"]["first"] == 5


def test_run_that_begins_again_is_a_new_epoch(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 4)
    feed.refresh()
    epoch = feed.content()["epoch"]
    source.layers = 1
    feed.refresh()
    assert feed.content(epoch, [5])["epoch"] != epoch
    assert heights_of(feed.content(epoch, [5])["runs"][0]).shape[0] == 2


def test_problem_of_a_folder_is_shown_until_it_is_gone(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 2)
    assert feed.content() == {"problem": "No layer is finished yet."}
    assert feed.refresh()
    good = source.runs

    def damaged() -> dict[str, Result]:
        raise ResultError("0002.npz: cannot be read")

    source.runs, source.layers = damaged, 3
    assert feed.refresh()
    assert feed.content() == {"problem": "0002.npz: cannot be read"}
    source.runs, source.layers = good, 4
    assert feed.refresh()
    assert heights_of(feed.content()["runs"][0]).shape[0] == 5
    assert feed.version == 3


def test_new_message_of_a_device_is_a_change_of_its_own(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 2)
    feed.refresh()
    epoch = feed.content()["epoch"]
    (tmp_path / "bench.log").write_text("a message\n")
    assert feed.refresh()
    assert not feed.refresh()
    assert source.readings == 2
    assert feed.content(epoch, [3])["epoch"] == epoch  # as many layers as before


def test_owner_of_a_run_is_looked_up_once_in_eight_looks(tmp_path: Path) -> None:
    source, owners = Still(printed()), list[str]()

    def owner() -> str:
        owners.append(f"Being printed by process {len(owners)}.")
        return owners[-1]

    feed = Feed(source, owner, tmp_path / "bench.log", 6)
    changed = [feed.refresh() for _ in range(17)]
    assert [number for number, is_new in enumerate(changed) if is_new] == [0, 8, 16]
    assert feed.content()["state"].endswith(": 0 layers. Being printed by process 2.")


def test_only_a_run_that_has_not_ended_has_a_state(tmp_path: Path) -> None:
    found = {}
    for reason in ("running", "interrupted", "target reached"):
        record = {"schema_version": SCHEMA_VERSION, "stop_reason": reason}
        (tmp_path / RUN_FILE).write_text(json.dumps(record))
        found[reason] = state_of(tmp_path)
    unowned = f"No process of this machine prints it; `inkloop resume {tmp_path}` continues it."
    assert found == {"running": unowned, "interrupted": unowned, "target reached": ""}


def test_runs_that_are_compared_share_the_cells_of_the_last_maps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def content(runs: Any, maps: Any, known: Any, cells: float) -> dict[str, Any]:
        asked.append((list(runs), [len(each.heights) for each in maps], list(known), cells))
        return {"state": ""}

    monkeypatch.setattr("inkloop.report.page.feed.content", content)
    source = Still(printed())
    two = {
        name: Result(printed().dataset.isel(layer=slice(count)), printed().run) for name, count in (("a", 3), ("b", 5))
    }
    source.runs = lambda: two
    feed = Feed(source, lambda: "", tmp_path / "bench.log", 6)
    feed.refresh()
    feed.content("0", [2, 5])
    feed.content("0", [2])
    feed.content("1", [2, 5])
    cells = FINAL_CELLS / 2
    assert asked == [(["a", "b"], [3, 5], known, cells) for known in ([2, 5], [], [])]


def test_blocks_have_room_for_half_as_many_layers_again_and_larger_ones_begin_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, blocks = [], iter([2, 1, 3, 3])

    def first_block(runs: Any, room: float, layers: int) -> int:
        asked.append((list(runs), layers))
        return next(blocks)

    monkeypatch.setattr("inkloop.report.page.feed.first_block", first_block)
    source = Still(printed())
    source.runs = lambda: {  # a new result each time
        name: Result(printed().dataset.isel(layer=slice(count)), printed().run) for name, count in (("a", 3), ("b", 5))
    }
    feed = Feed(source, lambda: "", tmp_path / "bench.log", 7)
    epochs = []
    for source.layers in range(4):
        feed.refresh()
        epochs.append(feed.content()["epoch"])
    assert asked == [(["a", "b"], 21)] * 4
    assert epochs == [epochs[0]] * 2 + [epochs[2]] * 2
    assert epochs[0] != epochs[2]


def test_watch_says_where_it_serves_on_this_machine_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bound = list[Any]()

    class Host:
        def run(self, sockets: Any) -> None:
            bound.extend(each.getsockname() for each in sockets)
            raise KeyboardInterrupt

    monkeypatch.setattr(server, "server", lambda feed: Host())
    unfinished(quick_cuboid(), tmp_path / "run", 0)
    assert main(["watch", str(tmp_path / "run"), "--port", "0", "--json"]) == 0
    ((host, port),) = bound
    assert host == "127.0.0.1"
    assert json.loads(capsys.readouterr().out) == {"folder": str(tmp_path / "run"), "url": f"http://127.0.0.1:{port}/"}


def test_numbers_of_layers_have_eight_digits_at_most(tmp_path: Path) -> None:
    asked = []
    feed: Any = SimpleNamespace(
        content=lambda epoch, known: asked.append((epoch, known)) or {"runs": []}, refresh=lambda: False, version=0
    )
    with served(feed) as port:
        answers = [asked_page(port, f"/content?epoch=4&known={known}") for known in ("3,12345678", "3,123456789,x", "")]
        _, _, headers = asked_page(port, "/")
    assert asked == [("4", [3, 12345678]), ("4", [3]), ("4", [])]
    assert {(status, body) for status, body, _ in answers} == {(200, b'{"runs":[]}')}
    assert answers[0][2]["Content-Type"] == "application/json"
    assert "; frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["Content-Security-Policy"].startswith(page.POLICY)


def test_stream_sends_the_newest_change_only(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path)

    async def watched() -> list[str]:
        events, ended = server.Events(feed), anyio.Event()
        await events.look()
        stream = events.stream(ended)
        sent = [(await anext(stream))["data"]]
        for source.layers in (1, 2, 3):
            await events.look()
        sent.append((await anext(stream))["data"])
        waiting = asyncio.ensure_future(anext(stream, {"data": "end"}))
        await asyncio.sleep(0)
        assert not waiting.done()  # nothing is new
        ended.set()
        await events.look()
        return [*sent, (await waiting)["data"]]

    assert asyncio.run(watched()) == ["1", "4", "end"]


@contextmanager
def served(feed: Feed) -> Iterator[int]:
    """The port on which a feed is served by a thread."""
    listening = socket.create_server((server.HOST, 0))
    host = server.server(feed)
    thread = threading.Thread(target=host.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        yield listening.getsockname()[1]
    finally:
        host.should_exit = True
        thread.join()


def asked_page(port: int, path: str, method: str = "GET", host: str = "") -> tuple[int, bytes, Any]:
    connection = http.client.HTTPConnection(server.HOST, port, timeout=60)
    connection.request(method, path, headers={"Host": host} if host else {})
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


def test_server_answers_this_machine_only_and_tells_of_layers(tmp_path: Path) -> None:
    unfinished(quick_cuboid(), tmp_path / "run", 1)
    with served(feed_of(tmp_path / "run")) as port:
        connection = http.client.HTTPConnection(server.HOST, port, timeout=60)
        connection.request("GET", "/events")
        events = connection.getresponse()
        assert events.getheader("Content-Type", "").startswith("text/event-stream")
        lines = (line for line in islice(events, LINES_MAX) if line.startswith(b"data:"))
        before = next(found for _ in lines if (found := layers_at(port)))  # the first event may come before the files
        resume_one_layer(tmp_path / "run")
        assert any(layers_at(port) > before for _ in lines)  # each event is waited for; no clock is looked at
        events.close()
        connection.close()
        for host, status in (("", 200), (f"localhost:{port}", 200), (EVIL, 400), (f"{EVIL}:{port}", 400)):
            assert asked_page(port, "/", host=host)[0] == status
            assert asked_page(port, "/content", host=host)[0] == status
        assert [asked_page(port, path, "POST")[0] for path in ("/", "/content", "/events")] == [405] * 3
        _, _, headers = asked_page(port, "/")
        assert "script-src 'self'" in headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in headers
        for source in page.served().split('<script src="')[1:]:
            assert asked_page(port, f"/{source.partition(chr(34))[0]}")[0] == 200
        assert asked_page(port, "/../scenario.toml")[0] == asked_page(port, "/scenario.toml")[0] == 404


def layers_at(port: int) -> int:
    """Layers of the run that the server sends to a new page; 0 before it has read any."""
    found = json.loads(asked_page(port, "/content")[1])
    return int(found["runs"][0]["layers"]["heights"]["shape"][0]) if "runs" in found else 0


def resume_one_layer(folder: Path) -> None:
    """Print one more layer of a run, and end as a crash does."""
    scenario = Scenario.load(folder / "scenario.toml")
    count = len({path.stem[:4] for path in (folder / "layers").glob("[0-9]*.npz")})

    def stop(row: LayerRow) -> None:
        if row.layer > count:
            raise KeyError("stop")

    with pytest.raises(KeyError):
        Print(scenario, folder, on_layer=stop).run()


def test_print_that_is_watched_is_the_print_that_is_not(tmp_path: Path) -> None:
    """A reader looks after every layer; the arrays on disk are the same to the bit."""
    scenario = Scenario.load(quick_cuboid(), {"run.layers_max": 6})
    folder = tmp_path / "watched"
    Result.begin(folder, scenario.text, origin_of(scenario, compare=False))
    reader, seen = RunFolder(folder), list[int]()

    def look(row: LayerRow) -> None:
        if row.layer > 0:
            seen.append(next(iter(reader.runs().values())).dataset.sizes["layer"] - 1)

    Print(scenario, folder, on_layer=look).run()
    assert seen == [0, 1, 2, 3, 4, 5]
    alone, watched = printed().dataset, Result.load(folder).dataset
    assert set(alone.variables) == set(watched.variables)
    for name, values in alone.variables.items():
        if "reproducible" not in values.attrs:
            assert values.values.tobytes() == watched[name].values.tobytes(), name


def test_nodes_of_a_bench_are_shown_with_their_last_message(tmp_path: Path) -> None:
    log = tmp_path / "bench.log"
    assert devices(log) is None
    log.write_text(
        "2026-01-01 10:00:00.001 INFO slcan on socket://127.0.0.1:28550 is open\n"
        "2026-01-01 10:00:00.002 INFO head: idle\n"
        "2026-01-01 10:00:00.003 INFO cure: lamp on for 20 ms after pass 1 of 4, layer 1\n"
        "2026-01-01 10:00:00.004 WARNING head: nozzle 3 is silent: purge\n",
        encoding="utf-8",
    )
    found = devices(log)
    assert found is not None
    assert found["nodes"] == [
        ["head", "2026-01-01 10:00:00.004", "warning", "nozzle 3 is silent: purge"],
        ["cure", "2026-01-01 10:00:00.003", "", "lamp on for 20 ms after pass 1 of 4, layer 1"],
    ]
    assert len(found["log"]) == 4


def test_port_in_use_is_explained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    unfinished(quick_cuboid(), tmp_path / "run", 0)
    with socket.create_server((server.HOST, 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["watch", str(tmp_path / "run"), "--port", str(port)]) == 1
    assert f"port {port} is in use" in capsys.readouterr().err
    assert main(["watch", str(tmp_path / "run"), "--port", "65536"]) == 1
    assert "expected a number from 0" in capsys.readouterr().err
    assert main(["watch", str(tmp_path)]) == 1
    assert "holds no run.json" in capsys.readouterr().err


def test_missing_extra_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sse_starlette", None)
    assert main(["watch", str(tmp_path)]) == 1
    assert "needs the package sse-starlette: pip install 'inkloop[live]'" in capsys.readouterr().err
