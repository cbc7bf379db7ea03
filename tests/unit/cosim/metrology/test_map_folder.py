"""Maps of a folder are taken when they are whole, for the layer that they are of, and only if they show the part."""

from __future__ import annotations

import logging
import math
import os
import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Port, Status
from inkloop.components import catalog
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.errors import ComponentError, ScenarioError
from inkloop.master.master import Master
from inkloop.metrology import map_folder
from inkloop.metrology.folder_watch import FolderWatch, name_errors, numbered_files
from inkloop.metrology.map_folder import MapFolder
from inkloop.testing import job
from support.closed_loop import block
from support.toys import FunctionComponent

SECOND = 1_000_000_000
JOB = block()
FINE = 4
PIXEL_UM = JOB.pitch * 1e6 / FINE
CORNER_UM = -0.5 * (JOB.pitch * 1e6 - PIXEL_UM)


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_folder, "PATIENCE_S", 0.0)


def profiler(folder: Path, **options: Any) -> MapFolder:
    """A map folder of NPZ files, one in each cell's own pixels."""
    given = {"file_name": "{layer}.npz", "complete": "renamed", "offset_x_um": CORNER_UM, "offset_y_um": CORNER_UM}
    made = catalog.make("MapFolder", JOB, {"folder": str(folder), **given, **options})
    assert isinstance(made, MapFolder)
    made.initialize(0, printed(0))
    return made


def printed(layer: int) -> dict[str, Any]:
    return {"layers_printed": np.asarray(layer, np.int32)}


def surface(layer: int) -> Any:
    """A surface (nx, ny) [um] that no other layer has."""
    return np.where(JOB.mask, 8.0 * layer, 0.0) + np.arange(JOB.ny) + 0.1 * layer


def write(folder: Path, layer: int, heights: Any = None, fine: int = FINE) -> Path:
    heights = surface(layer) if heights is None else heights
    path = folder / f"{layer}.npz"
    np.savez(path, z_um=np.kron(heights, np.ones((fine, fine))), pixel_um=JOB.pitch * 1e6 / fine)
    return path


def scan(part: MapFolder, layer: int) -> dict[str, Any]:
    return dict(part.do_step(layer * SECOND, SECOND, printed(layer)))


def test_scan_is_busy_until_the_file_of_the_printed_layer_is_there_and_is_not_done_again(tmp_path: Path) -> None:
    part = profiler(tmp_path)
    outputs = scan(part, 0)
    assert (outputs["layers_scanned"], outputs["status"]) == (-1, Status.BUSY)
    write(tmp_path, 0)
    outputs = scan(part, 0)
    assert (outputs["layers_scanned"], outputs["status"]) == (0, Status.IDLE)
    np.testing.assert_allclose(outputs["measured_height"] * 1e6, surface(0), atol=1e-9)
    assert outputs["valid"].all()
    write(tmp_path, 0, surface(0) + 5.0)
    np.testing.assert_array_equal(scan(part, 0)["measured_height"], outputs["measured_height"])
    write(tmp_path, 3)
    later = scan(part, 3)  # the number jumps
    assert later["layers_scanned"] == 3
    np.testing.assert_allclose(later["measured_height"] * 1e6, surface(3), atol=1e-9)


def test_cell_that_was_not_measured_keeps_its_last_valid_height(tmp_path: Path) -> None:
    part = profiler(tmp_path)
    holes = surface(0)
    holes[0, 0] = np.nan
    write(tmp_path, 0, holes)
    assert scan(part, 0)["measured_height"][0, 0] == 0.0
    write(tmp_path, 1)
    known = scan(part, 1)["measured_height"]
    later = surface(2)
    later[4, 4] = np.nan
    write(tmp_path, 2, later)
    outputs = scan(part, 2)
    assert outputs["measured_height"][4, 4] == known[4, 4]
    assert np.argwhere(~outputs["valid"]).tolist() == [[4, 4]]


def test_later_files_may_come_once_the_print_has_begun_and_what_a_step_gave_stays(tmp_path: Path) -> None:
    part = profiler(tmp_path)
    scan(part, 0)
    write(tmp_path, 0)
    write(tmp_path, 1)
    outputs = scan(part, 0)
    assert outputs["layers_scanned"] == 0
    outputs["measured_height"][:] = 7.0
    assert scan(part, 0)["measured_height"].max() < 1.0


def test_recorded_scans_may_be_the_same(tmp_path: Path) -> None:
    part = profiler(tmp_path, replay=True)
    for layer in (0, 1):
        write(tmp_path, layer, surface(0))
        assert scan(part, layer)["layers_scanned"] == layer


def test_channel_names_one_of_several_maps(tmp_path: Path) -> None:
    both = {"z_um": surface(0), "other_um": surface(7), "pixel_um": JOB.pitch * 1e6}
    np.savez(tmp_path / "0.npz", **both)
    part = profiler(tmp_path, channel="other_um", offset_x_um=0.0, offset_y_um=0.0)
    np.testing.assert_allclose(scan(part, 0)["measured_height"] * 1e6, surface(7), atol=1e-9)


@pytest.mark.parametrize(("unit", "um"), [("nm", 1e-3), ("um", 1.0), ("mm", 1e3), ("m", 1e6)])
def test_heights_are_in_the_unit_given(tmp_path: Path, unit: str, um: float) -> None:
    np.save(tmp_path / "0.npy", surface(0) / um)
    pixel = {"pixel_um": JOB.pitch * 1e6, "offset_x_um": 0.0, "offset_y_um": 0.0}
    part = profiler(tmp_path, file_name="{layer}.npy", unit=unit, **pixel)
    np.testing.assert_allclose(scan(part, 0)["measured_height"] * 1e6, surface(0), atol=1e-9)


def half(layer: int) -> Any:
    """A surface of which nothing along the first half of x was measured."""
    heights = surface(layer)
    heights[: JOB.nx // 2 + 1] = np.nan
    return heights


REFUSALS: dict[str, tuple[Callable[[Path], object], dict[str, Any], str]] = {
    "nothing measured": (lambda f: write(f, 1, np.full(surface(1).shape, np.nan)), {}, "no pixel of it was measured"),
    "part not seen": (lambda f: write(f, 1, half(1)), {}, r"33% of the part's cells were measured; needs 50%"),
    "same again": (lambda f: write(f, 1, surface(0)), {}, "heights of the scan of layer 0 again"),
    "another field": (lambda f: write(f, 1, fine=5), {}, "has 50 x 45 pixels, the scans before it 40 x 36"),
    "no map": (lambda f: (f / "1.npz").write_bytes(b"half a"), {}, "is no array of numbers that NumPy saved"),
    "unit against the file": (lambda f: write(f, 1), {"unit": "mm"}, "heights in um, but unit is 'mm'"),
    "no datum": (
        lambda f: write(f, 1, np.where(JOB.mask, surface(1), np.nan)),
        {"datum": "plane"},
        "datum: 0 cells outside",
    ),
    "no part to fit to": (
        lambda f: write(f, 1, np.random.default_rng(1).random(surface(1).shape)),
        {"registration": "fit"},
        r"the part explains \d+% of its relief",
    ),
    "off the grid": (
        lambda f: write(f, 1),
        {"offset_x_um": 5000.0},
        r"field lies at x 5\.00 to 7\.63.*the grid at 0 to 2\.63 and 0 to 2\.37 mm",
    ),
}


@pytest.mark.parametrize(("write_second", "options", "message"), REFUSALS.values(), ids=REFUSALS)
def test_impossible_map_is_refused_with_a_message(
    write_second: Callable[[Path], object], options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    is_bad_already = {"unit", "offset_x_um"} & options.keys()
    part = profiler(tmp_path, **({} if is_bad_already else options))
    write(tmp_path, 0)
    scan(part, 0)
    if is_bad_already:
        part = profiler(tmp_path, **options)
    write_second(tmp_path)
    with pytest.raises(ComponentError, match=rf"layer 1: .*1\.npz: .*{message}"):
        scan(part, 1)


def test_files_of_an_earlier_print_are_refused_before_the_first_layer(tmp_path: Path) -> None:
    for layer in range(4):
        write(tmp_path, layer)
    with pytest.raises(
        ComponentError, match=r"1\.npz is there before layer 1 is printed.*3 such files.*move them away"
    ):
        scan(profiler(tmp_path), 0)
    assert scan(profiler(tmp_path, replay=True), 0)["layers_scanned"] == 0


def test_awaited_file_has_its_time_limit(tmp_path: Path) -> None:
    part = profiler(tmp_path, timeout_s=1e-6)
    with pytest.raises(
        ComponentError, match=r"0\.npz did not come within 1e-06 s; there is no file of any layer: scan layer 0"
    ):
        scan(part, 0)
    part = profiler(tmp_path, timeout_s=1e-6, complete="done")
    write(tmp_path, 0)
    part_of_two = profiler(tmp_path, timeout_s=1e-6, replay=True)
    write(tmp_path, 1)
    with pytest.raises(ComponentError, match=r"2\.npz did not come within 1e-06 s; the newest there is 1\.npz: scan"):
        scan(part_of_two, 2)
    (tmp_path / "1.npz").unlink()
    with pytest.raises(ComponentError, match=r"0\.npz was not complete within .*its \.done mark is missing"):
        scan(part, 0)
    with pytest.raises(ComponentError, match="is no folder; make it"):
        profiler(tmp_path / "nowhere")


GIVEN = {"fiducials_map_um": [[0, 0], [1000, 0]], "fiducials_grid_um": [[0, 0], [1100, 0]]}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"file_name": "scan.csv"}, r"file_name is 'scan.csv'; expected a name of its own for each layer"),
        ({"file_name": "{number}.csv"}, r"file_name is '\{number\}.csv' \(\{number\} is none of \{layer\}\)"),
        ({"file_name": "{layer:0999999999d}.csv"}, r"file_name is .* \(\{layer:0999999999d\} has a format other than"),
        ({"registration": "fiducials"}, "fiducials_map_um and fiducials_grid_um: give both"),
        ({"fiducials_map_um": [[0, 0], [1, 1]]}, "fiducials_map_um and fiducials_grid_um: give both"),
        ({"registration": "fiducials", **GIVEN}, r"the best fit leaves 50 µm rms, 26\.3 µm are allowed"),
        ({"unit": "inch"}, "unit is 'inch'"),
        ({"valid_share_min": 0.0}, "valid_share_min is 0.0"),
    ],
)
def test_invalid_options_are_reported_before_anything_runs(
    options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError, match=message):
        catalog.make("MapFolder", JOB, {"folder": str(tmp_path / "later"), **options})


def test_fiducials_place_the_map_as_the_numbers_they_stand_for(tmp_path: Path) -> None:
    write(tmp_path, 0)
    corners = [[0.0, 0.0], [1000.0, 0.0], [0.0, 2000.0]]
    points = {"fiducials_map_um": corners, "fiducials_grid_um": [[x + CORNER_UM, y + CORNER_UM] for x, y in corners]}
    found = profiler(tmp_path, registration="fiducials", **points, offset_x_um=0.0, offset_y_um=0.0)
    given = scan(profiler(tmp_path), 0)
    np.testing.assert_allclose(scan(found, 0)["measured_height"], given["measured_height"], atol=1e-12)


def test_options_of_a_place_are_lengths_and_angles() -> None:
    options = {"rotation_deg": 90.0, "offset_x_um": 5.0, "offset_y_um": -7.0, "mirror": "y"}
    place = MapFolder(JOB, folder=".", registration="fit", **options)._placement  # type: ignore[arg-type]
    offsets = place.registration.offset_x, place.registration.offset_y
    assert offsets == pytest.approx((5e-6, -7e-6), rel=1e-9, abs=0.0)
    assert place.registration == replace(place.registration, rotation=math.pi / 2, mirror="y")
    assert place.fit_reach == pytest.approx((3 * JOB.pitch, math.pi / 90), rel=1e-9, abs=0.0)
    own = MapFolder(JOB, folder=".", registration="fit", fit_reach_um=40.0, fit_reach_deg=9.0)._placement
    assert own.fit_reach == pytest.approx((40e-6, math.pi / 20), rel=1e-9, abs=0.0)
    assert MapFolder(JOB, folder=".")._placement.fit_reach is None


def test_fiducials_of_a_mirrored_map_are_those_of_its_mirror() -> None:
    points = {"fiducials_map_um": [[0, 0], [900, 0], [0, 300]], "fiducials_grid_um": [[0, 0], [900, 0], [0, -300]]}
    place = MapFolder(JOB, folder=".", registration="fiducials", mirror="y", **points)._placement  # type: ignore[arg-type]
    assert place.registration.mirror == "y"
    assert place.registration.rotation == pytest.approx(0.0, abs=1e-9)


def test_restored_folder_goes_on_after_its_last_scan(tmp_path: Path) -> None:
    """It looks for leftovers anew, and takes neither the same map again nor another field."""
    part = profiler(tmp_path)
    write(tmp_path, 0)
    before = scan(part, 0)
    other = profiler(tmp_path)
    other.restore(part.save())
    assert scan(other, 0)["layers_scanned"] == 0
    np.testing.assert_array_equal(scan(other, 1)["measured_height"], before["measured_height"])
    write(tmp_path, 1, surface(0))
    with pytest.raises(ComponentError, match="of layer 0 again"):
        scan(other, 1)
    write(tmp_path, 2)
    other.restore(part.save())
    with pytest.raises(ComponentError, match=r"2\.npz is there before layer 2 is printed"):
        scan(other, 1)
    (tmp_path / "2.npz").unlink()
    write(tmp_path, 1, fine=5)
    other.restore(part.save())
    with pytest.raises(ComponentError, match="the scans before it 40 x 36; scan the same field"):
        scan(other, 1)
    with pytest.raises(ComponentError, match="is no state of a map folder"):
        other.restore(b"rubbish")
    with pytest.raises(ComponentError, match=r"has \(10, 9\) cells; this grid has"):
        MapFolder(job(), folder=str(tmp_path)).restore(part.save())


class Clock:
    """Time that passes only by sleeping; what happens at a time is a list of (time, action)."""

    def __init__(self, events: list[tuple[float, Callable[[], object]]]) -> None:
        self.now, self._events = 0.0, events

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        while self._events and self._events[0][0] <= self.now:
            self._events.pop(0)[1]()


def watch(folder: Path, complete: Any, *events: tuple[float, Callable[[], object]]) -> tuple[FolderWatch, Clock]:
    clock = Clock(list(events))
    return FolderWatch(folder, "{layer}.csv", complete, 0.5, clock=clock, sleep=clock.sleep), clock


def test_growing_file_is_taken_when_it_stays_as_it_is_and_an_empty_one_never(tmp_path: Path) -> None:
    path = tmp_path / "7.csv"

    def grow() -> None:
        with path.open("a") as file:
            file.write("1,2,3\n")

    watched, clock = watch(tmp_path, "stable", (0.1, grow), (0.5, grow), (0.9, grow))
    assert watched.look(7, 0.05) is None
    assert watched.look(7, 0.5) == path
    assert clock.now >= 0.9 + 0.5
    assert path.read_text().count("\n") == 3
    path.write_text("")
    watched, clock = watch(tmp_path, "stable")
    assert watched.look(7, 3.0) is None
    assert clock.now >= 3.0


def test_file_that_is_written_again_in_the_same_size_is_another_one(tmp_path: Path) -> None:
    path = tmp_path / "7.csv"
    path.write_text("1,2\n")
    watched, clock = watch(tmp_path, "stable", (0.3, lambda: os.utime(path, ns=(1, 1))))
    assert watched.look(7, 0.0) == path
    assert clock.now >= 0.3 + 0.5


def test_done_mark_completes_a_file(tmp_path: Path) -> None:
    (tmp_path / "7.csv").write_text("1,2\n")
    watched, _ = watch(tmp_path, "done", (0.4, (tmp_path / "7.csv.done").touch))
    assert watched.look(7, 0.2) is None
    assert watched.look(7, 0.5) == tmp_path / "7.csv"


def test_wait_is_told_after_two_seconds_and_then_every_half_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now = [0.0]

    class Watch(FolderWatch):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given, clock=lambda: now[0], sleep=lambda seconds: None)

    monkeypatch.setattr(map_folder, "FolderWatch", Watch)
    caplog.set_level(logging.INFO)
    part = profiler(tmp_path, timeout_s=70.0)
    messages = []
    for now[0] in (0.0, 1.9, 2.0, 10.0, 31.9, 32.0, 33.0, 62.0, 70.0):
        before = len(caplog.records)
        scan(part, 3)
        messages += [(now[0], record.getMessage()) for record in caplog.records[before:]]
    assert [time for time, _ in messages] == [2.0, 32.0, 62.0]
    path = tmp_path / "3.npz"
    assert messages[1][1] == f"layer 3 is printed: waiting for {path} since 32 s (up to 70 s)"
    now[0] = 70.1
    with pytest.raises(ComponentError, match=r"3\.npz did not come within 70 s"):
        scan(part, 3)
    part = profiler(tmp_path, timeout_s=70.0)
    for now[0], layer in ((0.0, 3), (60.0, 4), (130.0, 4)):  # a later layer is awaited anew
        assert scan(part, layer)["status"] == Status.BUSY


def test_files_have_the_number_of_their_layer(tmp_path: Path) -> None:
    wrong = ("scan_12_b2.csv", "scan_0007_b3.csv", "x_0001_b2.csv", "a.txt")
    for name in ("scan_0007_b2.csv", "scan_0012_b2.csv", *wrong):
        (tmp_path / name).touch()
    found = numbered_files(tmp_path, "scan_{layer:04d}_b2.csv", "layer")
    assert {number: path.name for number, path in found.items()} == {7: "scan_0007_b2.csv", 12: "scan_0012_b2.csv"}
    (tmp_path / "b2_5.csv").touch()
    assert list(numbered_files(tmp_path, "b2_{layer}.csv", "layer")) == [5]
    assert name_errors("file_name", "a{layer}.csv", "layer", "b") == []
    for template in ("a.csv", "../{layer}.csv", "{layer:.0f}/x.csv"):
        (error,) = name_errors("file_name", template, "layer", "b")
        assert "expected a name of its own for each layer, such as 'b'" in error


def test_first_ctrl_c_ends_the_wait_for_a_file(tmp_path: Path) -> None:
    printer = FunctionComponent(outputs=[Port("layers_printed", dtype="int32")])
    parts: dict[str, Component] = {"printer": printer, "profiler": profiler(tmp_path)}
    master = Master(parts, contract_connections(parts), step_ns=SECOND, course=LayerCourse(parts, layers_max=1))
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    assert master.run() == "interrupted"
