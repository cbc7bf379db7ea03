"""The live page: what it is sent while a part is printed, to whom, and that the print does not notice."""

from __future__ import annotations

import errno
import http.client
import json
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.commands import runs
from inkloop.errors import InkloopError, ResultError
from inkloop.printing.print import Print
from inkloop.printing.run import origin_of, print_part
from inkloop.printing.so_far import RunFolder, state_of
from inkloop.report.page import live as server
from inkloop.report.page import page
from inkloop.report.page.live import Feed
from inkloop.results.recorder import LayerRow
from inkloop.results.result import RUN_FILE, SCHEMA_VERSION, Result
from inkloop.scenario.file import Scenario
from support.once_per_run import once
from support.pages import heights_of, unfinished, unpacked
from support.prints import quick_cuboid

EVIL = "evil.example"
QUERIES = ("epoch=4&known=3,12345678", "epoch=4&known=3,123456789,x", "version=7&epoch=4", "")


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


def sent(feed: Feed, version: str = "", epoch: str = "", known: Sequence[int] = ()) -> dict[str, Any]:
    """A content that is new to a page."""
    found = feed.content(version, epoch, known)
    assert found is not None
    return found


def test_page_gets_the_layers_that_it_does_not_have_whatever_it_missed(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 1)
    first = sent(feed)
    assert heights_of(first["runs"][0]).shape[0] == 2
    assert feed.content(first["version"], first["epoch"], [2]) is None
    assert source.readings == 1
    for source.layers in (2, 3, 5):
        sent(feed)  # to another page
    later = sent(feed, first["version"], first["epoch"], [2])["runs"][0]["layers"]
    assert later["first"] == 1  # which may have been scanned since
    steps = np.cumsum(unpacked(later["heights"]).astype(np.int64), axis=0)
    before = heights_of(first["runs"][0])[0]
    expected = printed().dataset.height.values[1:6] * 1e6
    assert np.abs(before + steps * 0.01 - expected).max() <= 0.005 * (1 + 1e-9)
    assert heights_of(sent(feed, known=[2])["runs"][0]).shape[0] == 6  # of another epoch: all of them
    assert sent(feed, "1", first["epoch"], [10**8])["runs"][0]["layers"]["first"] == 5


def test_page_gets_everything_of_another_watcher_and_of_a_run_that_begins_again(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 4)
    before = sent(feed)
    other = sent(feed_of_six(tmp_path, 4)[0], before["version"], before["epoch"], [5])
    assert heights_of(other["runs"][0]).shape[0] == 5
    source.layers = 1
    after = sent(feed, before["version"], before["epoch"], [5])
    assert len({found["epoch"] for found in (before, other, after)}) == 3
    assert heights_of(after["runs"][0]).shape[0] == 2


def test_problem_of_a_folder_is_shown_until_it_is_gone(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 2)
    good, page_has = source.runs, sent(feed)

    def damaged() -> dict[str, Result]:
        raise ResultError("0002.npz: cannot be read")

    source.runs, source.layers = damaged, 3
    for _ in range(2):
        assert feed.content(page_has["version"], page_has["epoch"], [3]) == {"problem": "0002.npz: cannot be read"}
    source.runs = good
    later = sent(feed, page_has["version"], page_has["epoch"], [3])
    assert later["runs"][0]["layers"]["first"] == 2


def test_new_message_of_a_device_is_a_change_of_its_own(tmp_path: Path) -> None:
    feed, source = feed_of_six(tmp_path, 2)
    first = sent(feed)
    (tmp_path / "bench.log").write_text("2026-01-01 10:00:00.002 INFO head: idle\n")
    later = sent(feed, first["version"], first["epoch"], [3])
    assert later["epoch"] == first["epoch"]  # as many layers as before
    assert later["tables"]["nodes"]["rows"] == [["head", "2026-01-01 10:00:00.002", "", "idle"]]
    assert feed.content(later["version"], later["epoch"], [3]) is None
    assert source.readings == 2


def test_owner_of_a_run_is_looked_up_once_in_eight_looks(tmp_path: Path) -> None:
    owners = list[str]()

    def owner() -> str:
        owners.append(f"Being printed by process {len(owners)}.")
        return owners[-1]

    feed = Feed(Still(printed()), owner, tmp_path / "bench.log", 6)
    states = [sent(feed)["texts"]["state"] for _ in range(17)]
    assert [states.index(state) for state in dict.fromkeys(states)] == [0, 8, 16]
    assert states[-1].endswith(": 0 layers. Being printed by process 2.")


def test_only_a_run_that_has_not_ended_has_a_state(tmp_path: Path) -> None:
    found = {}
    for reason in ("running", "interrupted", "target reached"):
        record = {"schema_version": SCHEMA_VERSION, "stop_reason": reason}
        (tmp_path / RUN_FILE).write_text(json.dumps(record))
        found[reason] = state_of(tmp_path)
    unowned = f"No process of this machine prints it; `inkloop resume {tmp_path}` continues it."
    assert found == {"running": unowned, "interrupted": unowned, "target reached": ""}


def test_blocks_have_room_for_half_as_many_layers_again_and_larger_ones_begin_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, blocks = [], iter([2, 1, 3, 3])

    def first_block(runs: Any, room: float, layers: int) -> int:
        asked.append((list(runs), layers))
        return next(blocks)

    monkeypatch.setattr("inkloop.report.page.page.first_block", first_block)
    source = Still(printed())
    source.runs = lambda: {  # a new result each time
        name: Result(printed().dataset.isel(layer=slice(count)), printed().run) for name, count in (("a", 3), ("b", 5))
    }
    feed, epochs = Feed(source, lambda: "", tmp_path / "bench.log", 7), []
    for source.layers in range(4):
        found = sent(feed)
        epochs.append(found["epoch"])
        assert [run["block"] for run in found["runs"]] == [[2, 2, 3, 3][source.layers]] * 2
        later = feed.content("", found["epoch"], [3, 5])  # as many runs as before, or all again
        assert [run["layers"]["first"] for run in later["runs"]] == [2, 4] if later else None
        again = sent(feed, "", found["epoch"], [3])
        assert [run["layers"]["first"] for run in again["runs"]] == [0, 0]
    assert asked == [(["a", "b"], 21)] * 4
    assert len(set(epochs[:2])) == len(set(epochs[2:])) == 1
    assert epochs[0] != epochs[2]


def test_watch_says_where_it_serves_on_this_machine_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bound = list[Any]()

    def serve_forever(host: server.Server) -> None:
        bound.append(host.server_address)
        raise KeyboardInterrupt

    monkeypatch.setattr(server.Server, "serve_forever", serve_forever)
    unfinished(quick_cuboid(), tmp_path / "run", 0)
    assert main(["watch", str(tmp_path / "run"), "--port", "0", "--json"]) == 0
    ((host, port),) = bound
    assert host == "127.0.0.1"
    assert json.loads(capsys.readouterr().out) == {"folder": str(tmp_path / "run"), "url": f"http://127.0.0.1:{port}/"}


@contextmanager
def served(feed: Any) -> Iterator[int]:
    """The port on which a feed is served by a thread."""
    with server.Server(feed, 0) as host:
        thread = threading.Thread(target=host.serve_forever)
        thread.start()
        try:
            yield host.server_port
        finally:
            host.shutdown()
            thread.join()


def asked_page(port: int, path: str, method: str = "GET", host: str = "") -> tuple[int, bytes, Any]:
    connection = http.client.HTTPConnection(server.HOST, port, timeout=60)
    connection.request(method, path, headers={"Host": host} if host else {})
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


def test_server_answers_this_machine_only_and_only_with_the_page() -> None:
    asked = list[Any]()
    feed = SimpleNamespace(content=lambda *known: asked.append(known) or (None if known[0] else {"runs": []}))
    with served(feed) as port:
        for host, status in (("", 200), (f"localhost:{port}", 200), (EVIL, 400), (f"{EVIL}:{port}", 400)):
            assert asked_page(port, "/", host=host)[0] == status
            assert asked_page(port, "/content", host=host)[0] == status
        assert [asked_page(port, path, "POST")[0] for path in ("/", "/content")] == [501, 501]
        _, body, headers = asked_page(port, "/")
        assert headers["Content-Security-Policy"].startswith(f"{page.POLICY}; script-src 'self'; connect-src 'self'; ")
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in headers
        sources = body.decode().split('<script src="')[1:]
        assert len(sources) == 1 + len(page.SCRIPTS)
        assert {asked_page(port, f"/{source.partition(chr(34))[0]}")[0] for source in sources} == {200}
        assert asked_page(port, "/../scenario.toml")[0] == asked_page(port, "/scenario.toml")[0] == 404
        asked.clear()
        answers = [asked_page(port, f"/content?{query}") for query in QUERIES]
    assert asked == [("", "4", [3, 12345678]), ("", "4", [3]), ("7", "4", []), ("", "", [])]
    assert [(status, body) for status, body, _ in answers] == [(200, b'{"runs":[]}')] * 2 + [(204, b""), answers[0][:2]]
    assert answers[0][2].get_content_type() == "application/json"


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


def test_port_is_one_that_a_machine_has(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Mock()
    monkeypatch.setattr(server, "Server", made)
    feed: Any = None
    for port in (0, 1, 65_535):
        runs._server(feed, port)
    assert [each.args[1] for each in made.call_args_list] == [0, 1, 65_535]
    for port in (-1, 65_536):
        with pytest.raises(InkloopError, match=f"--port is {port}; expected a number from 0, any free port, to 65535"):
            runs._server(feed, port)
    for number, words in ((errno.EADDRINUSE, "is in use, perhaps by another inkloop watch"), (errno.EACCES, "denied;")):
        made.side_effect = OSError(number, "denied")
        with pytest.raises(InkloopError, match=f"port 80 .*{words}"):
            runs._server(feed, 80)
