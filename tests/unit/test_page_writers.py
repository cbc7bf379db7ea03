"""Writers of pages by hand-made inputs: each figure in its unit, each heading and rule where it belongs."""

from __future__ import annotations

import argparse
import dataclasses
import enum
from types import SimpleNamespace
from typing import Any

import pytest
from benchmarks import timing
from benchmarks.prints import OPEN_LOOP, Case, Figure, Wanted, table
from benchmarks.record import tables_of
from rich.console import Group
from rich.table import Table
from rich.text import Text
from tools import weight
from tools.figures import (
    api,
    can_protocol,
    command_line,
    diagrams,
    gallery,
    house,
    lying_scans,
    options,
    pages,
    performance,
    the_papers,
)
from tools.figures import closed_loop as closed_loop_page

import inkloop
from inkloop.fmu_writer import definition
from support.lying_scans.cases import CASES
from support.places import ROOT


def test_weight_counts_lines_words_and_riddles(tmp_path: Any) -> None:
    (tmp_path / "a.py").write_text('"""What it is."""\n\n# How not\nx = "What "\n')
    (tmp_path / "b.c").write_text("/* How it goes */\n// What else\nint x; /* a What */\n")
    both = [tmp_path / "a.py", tmp_path / "b.c"]
    assert weight.lines(both) == 7
    assert weight.RIDDLE.findall(weight.text(both)) == ['"""What ', "/* How ", "// What "]
    assert (weight.thousands(1249), weight.thousands(51)) == ("1.2", "0.1")


def test_table_has_empty_cells_and_rules_for_numbers() -> None:
    rows = [("a", "1.5", "", "3 ± 1"), ("b", "-2", "x", "+4")]
    assert pages.table(("what", "n", "t", "m"), rows).splitlines()[1:] == [
        "| what | n | t | m |", "|---|---:|---|---:|", "| a | 1.5 | | 3 ± 1 |", "| b | -2 | x | +4 |",
    ]  # fmt: skip


def prints(*ends: tuple[str, int, str]) -> list[dict[str, str]]:
    return [{"ending": ending, "layers": f"{layers}", "untrusted_from": at} for ending, layers, at in ends]


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ([("done", 9, ""), ("done", 8, "")], "done"),
        ([("done", 9, "12"), ("done", 8, "7"), ("done", 8, "")], "2 of 3 untrusted from layer 7 on"),
        ([("stopped", 12, "3"), ("stopped", 9, "3"), ("done", 8, "")], "stopped at layer 9 to 12"),
        ([("stopped", 5, "3"), ("stopped", 5, "4")], "stopped at layer 5"),
    ],
)
def test_ends_of_lying_prints_are_told_in_the_order_of_layers(ends: list[Any], words: str) -> None:
    assert lying_scans.ending(prints(*ends)) == words


def test_row_of_a_lying_case_has_the_mean_and_the_worst_of_its_seeds() -> None:
    found: dict[str, Any] = {
        name: [
            {**each, "mae": mae, "highest": highest}
            for each, mae, highest in zip(
                prints(*[("done", 9, "")] * 3), ("0.2", "0.4", "0.9"), ("2", "7", "3"), strict=True
            )
        ]
        for name in lying_scans.ON_PAGE
    }
    first = next(lying_scans.lines(found))
    must = CASES["in register, 20 %"].must
    assert first == ["in register, 20 %", f"0.50 / {must.mae:g}", f"7.0 / {must.highest:g}", "done"]
    assert any(line[0] == "levelled anew: offset and tilt 3 µm" for line in lying_scans.lines(found))
    assert lying_scans.limit(float("nan")) == ""


@pytest.mark.parametrize(
    ("value", "absent", "shown"),
    [(None, "none", "none"), (0.5, "", "0.5"), (2.0, "", "2"), (3, "", "3"), (True, "", "`true`"), ("a", "", '`"a"`')],
)
def test_default_of_an_option_is_what_a_scenario_would_say(value: object, absent: str, shown: str) -> None:
    assert options.default(value, absent) == shown


def test_row_of_an_option_begins_small_with_its_values_as_code() -> None:
    assert options.row("k", "3", "The key") == "- `k` (3): the key"
    assert options.row("k", "", "The key") == "- `k`: the key"
    assert options.with_code('"none", or "a-b.{layer}"; say "so it is"') == (
        '`"none"`, or `"a-b.{layer}"`; say "so it is"'
    )


def test_commands_show_their_own_arguments_as_they_are_typed() -> None:
    whole = argparse.ArgumentParser(prog="it")
    above = whole.add_subparsers()
    run = above.add_parser("run", help="run a thing")
    run.add_argument("file", metavar="FILE", help="the thing")
    run.add_argument("--fast", "-f", action="store_true", help="hurry")
    run.add_argument("--level", choices=(1, 2), help="how far")
    run.add_argument("--json", action="store_true", help="of all commands")
    nested = above.add_parser("bench", help="the bench").add_subparsers()
    nested.add_parser("check", help="look at it")
    commands = list(command_line._commands(whole))
    assert [(each.prog, meaning) for each, meaning in commands] == [
        ("it run", "run a thing"),
        ("it bench check", "look at it"),
    ]
    assert command_line._section(*commands[0], {"json"}) == (
        "\n## it run\n\nRun a thing.\n\n- `FILE`: the thing\n- `--fast, -f`: hurry\n- `--level 1|2`: how far\n"
    )


def test_figures_of_the_gallery_are_in_the_units_of_their_names() -> None:
    metrics = {"mean_error": -1.23456e-6, "mae": 2e-6, "std": 3e-6, "layers": 5.0, "droplets": 70.0, "rms": 1.0}
    run: Any = SimpleNamespace(metrics=lambda: metrics, dataset=SimpleNamespace(attrs={"seed": 7}))
    expected = {"mean_error_um": -1.2346, "mae_um": 2.0, "std_um": 3.0, "layers": 5, "droplets": 70}
    assert gallery.figures(run) == expected
    metrics["mismatch"] = 0.0123456
    assert gallery.figures(run) == {**expected, "mismatch_percent": 1.235}
    assert gallery.measured({"ours": run}) == {"seed": 7, "runs": {"ours": gallery.figures(run)}}
    assert gallery.shown(gallery.figures(run)) == "-1.23 ± 3.00 µm (mismatch 1.2 %)"
    assert gallery.shown({"mean_error_um": -0.001, "std_um": 0.456}) == "0.00 ± 0.46 µm"


def test_entry_of_the_gallery_has_the_figures_that_its_picture_lacks() -> None:
    record = {"runs": {"ours": {"mean_error_um": 0.5, "std_um": 1.0}, "open": {"mean_error_um": 2.0, "std_um": 3.0}}}
    path = ROOT / "scenarios" / "tilted-substrate.toml"
    with_figures = gallery.entry(path, record)
    assert (
        "Error: ours 0.50 ± 1.00 µm; open 2.00 ± 3.00 µm.\n\n![tilted-substrate](tilted-substrate.png)" in with_figures
    )
    assert "Error:" not in gallery.entry(ROOT / "scenarios" / "cuboid.toml", record)
    assert gallery.LOOK_AT not in with_figures


def test_papers_page_shows_the_printed_figures_that_are_not_reproduced(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        ["T 1", "a", "µm", "5", "5.1", "0.2", "yes"],
        ["T 1", "b", "µm", "5", "4", "0.2", "no, smaller"],
        ["T 1", "c", "µm", "5", "6", "0.2", "no, larger"],
        ["T 2", "d", "µm", "-", "6", "0.2", "-"],
        ["T 2", "e", "µm", "3", "6", "-", "-"],
        ["T 2", "f", "µm", "3", "6", "0.2", "no, larger"],
    ]
    monkeypatch.setattr(the_papers, "rows_of", lambda paper: rows)
    lines = the_papers.printed_figures("lu").strip().splitlines()
    assert lines[0] == "Reproduced: 1 of 4 printed figures that can be compared. The others:"
    assert [line.split("|")[1:3] for line in lines[-3:]] == [[" T 1 ", " b "], [" ", " c "], [" T 2 ", " f "]]


def test_parts_of_the_record_on_speed_are_measured_anew_and_the_others_kept(tmp_path: Any, monkeypatch: Any) -> None:
    from benchmarks import on_device, record

    monkeypatch.setattr(performance, "RECORD", tmp_path / "record.json")
    monkeypatch.setattr(
        record, "measured", lambda parts, console: {"tables": [{"benchmark": part, "n": 2} for part in parts]}
    )
    monkeypatch.setattr(on_device, "measure", lambda: "")
    old = [{"benchmark": name, "n": 1} for name in ("layer_map", "master", "columns")]
    pages.write_json(performance.RECORD, {"tables": old})
    performance.run("master", "estimator")
    found = [(each["benchmark"], each["n"]) for each in pages.read_json(performance.RECORD)["tables"]]
    assert found == [("layer_map", 1), ("estimator", 2), ("master", 2), ("columns", 1)]


def test_page_on_speed_leaves_out_columns_that_follow_from_others() -> None:
    shown = performance._shown(["grid", "gain", "time"], [["3 x 3", "9", "1 s"], ["4 x 4", "8", "2 s"]])
    assert [line.count("|") for line in shown.strip().splitlines()] == [3] * 4
    assert "9" not in shown


@pytest.mark.parametrize(
    ("time_s", "text"), [(1e-3, "1 ms"), (0.9994e-3, "999 us"), (2.5e-6, "2.5 us"), (1e-6, "1 us"), (3e-8, "30 ns")]
)
def test_times_are_shown_in_the_unit_that_reads_best(time_s: float, text: str) -> None:
    assert timing.scaled(time_s) == text


def test_notes_of_a_benchmark_stand_under_its_last_table() -> None:
    one, two, inner = (Table(title=f"{name}\n of it") for name in ("one", "two", "inner"))
    for made in (one, two, inner):
        made.add_column(" a\nb")
        made.add_row("1")
        made.add_row(Text("2"))
    found = list(tables_of(Group(one, two, Text("a note"), Group(inner, Text("its own")))))
    assert [(each["title"], each["notes"]) for each in found] == [
        ("one of it", []), ("two of it", ["a note"]), ("inner of it", ["its own"]),
    ]  # fmt: skip
    assert all((each["headings"], each["rows"]) == (["a b"], [["1"], ["2"]]) for each in found)
    assert [each["notes"] for each in tables_of(one)] == [[]]


def test_figures_of_prints_are_judged_at_their_limits() -> None:
    nan = float("nan")
    judged = [
        Figure("f", (2.0,), must, aim).reached
        for must, aim in ((nan, nan), (3.0, 2.0), (2.0, 1.0), (nan, 1.0), (0.0, 0.0))
    ]
    assert judged == ["-", "aim", "must", "not the aim", "MISSED"]
    row = Figure("f", (9.0, 11.0), 3.0, open_loop=(0.1234,), printed="7").row()
    assert row == ("f", "10", "1.4", "0.123", "7", "3", "-", "MISSED: 3.33 x")
    assert Figure("f", (12.345,)).row()[1:4] == ("12.35" if round(12.345, 2) == 12.35 else "12.34", "-", "-")


def test_table_of_prints_has_no_empty_columns_and_names_a_case_once() -> None:
    shown = table("t", {"one": [Figure("a", (1.0,)), Figure("b", (2.0,))], "two": [Figure("a", (3.0,), must=4.0)]})
    assert [str(column.header) for column in shown.columns] == ["case", "figure", "ours", "must", "reached"]
    cells = list(zip(*(column.cells for column in shown.columns), strict=True))
    assert [row[:3] for row in cells] == [("one", "a", "1"), ("", "b", "2"), ("two", "a", "3")]
    assert [row.end_section for row in shown.rows] == [False, True, True]


def test_metrics_of_a_print_are_of_its_last_surface_and_of_the_shift_after_ten_layers(monkeypatch: Any) -> None:
    import xarray as xr
    from benchmarks import prints as benchmark

    layers = 13
    shift = {
        f"scan_shift_{axis}": ("layer", [sign * (0.1e-6 * k) for k in range(layers)])
        for axis, sign in (("x", 1), ("y", -1))
    }
    dataset = xr.Dataset({**shift, "untrusted_reasons": ("layer", [0, 4, 0, 8] + [0] * (layers - 4))})
    result: Any = SimpleNamespace(dataset=dataset, metrics=lambda: {"min": -7e-6, "max": 3e-6})
    scenario: Any = SimpleNamespace(
        job=lambda: SimpleNamespace(pitch=1e-6), options=lambda name: {"shift_x_um": 0.8, "shift_y_um": -0.7}
    )
    found = benchmark._measured(result, scenario)
    assert (found["highest"], found["untrusted"]) == (7e-6, 2.0)
    assert found["shift_error"] == pytest.approx(0.5, rel=1e-9, abs=0.0)  # 1.1 - 0.8 and 0.7 - 1.1 um
    short: Any = SimpleNamespace(dataset=dataset.isel(layer=slice(0, 11)), metrics=result.metrics)
    assert str(benchmark._measured(short, scenario)["shift_error"]) == "nan"


def test_blind_print_of_a_case_is_its_comparison_or_the_scenario_itself(monkeypatch: Any) -> None:
    from benchmarks import prints as benchmark

    monkeypatch.setattr(benchmark, "print_part", lambda scenario: scenario)
    monkeypatch.setattr(benchmark, "_measured", lambda result, scenario: result.tables)
    wanted = (Wanted("mae"),)
    for name in ("cylinder", "cylinder-open-loop"):
        case = Case(name, benchmark.SCENARIOS / f"{name}.toml", wanted, {"run.layers_max": 3})
        tables: Any = benchmark.one_print(case, OPEN_LOOP, 4)
        assert tables.components["controller"].kind == "OpenLoop"
        assert (tables.label, tables.seed, tables.run.layers_max) == (OPEN_LOOP, 4, 3)
    case = Case("it", benchmark.SCENARIOS / "cylinder.toml", wanted)
    ours: Any = benchmark.one_print(case, benchmark.FLIPS, 2)
    assert ours.components["controller"].kind == "StochasticGreedy"
    assert ours.components["controller"].options["horizon"] == 5


def test_small_figures_of_the_page_have_three_decimals() -> None:
    shown = [closed_loop_page.cell(Figure("f", (now,), must=2.0)) for now in (0.0099, 0.01, 1.2345)]
    assert shown == ["0.010 / 2", "0.01 / 2", "1.23 / 2"]


class Mine:
    """A component of one's own."""

    def do_step(self, time_ns: int, step_ns: int, inputs: Any) -> Any:
        """As every component does."""

    def refill(self) -> None:
        """A feature of its own."""


class Colour(enum.IntEnum):
    """A colour."""

    RED = 1
    BLUE = 2


@dataclasses.dataclass
class Thing:
    """A thing.

    More of it.
    """

    size: float
    names: list[str] = dataclasses.field(default_factory=list)

    @classmethod
    def of(cls, text: str, /, *, strict: bool = True, **others: int) -> Thing:
        """Makes one.

        In a way.
        """
        raise NotImplementedError

    @property
    def weight(self) -> float:
        """Its weight."""
        return 0.0

    def grow(self, by: float = 1.5, *, fast: bool, far: bool = False) -> None:
        """Grows."""

    def _hidden(self) -> None:
        """Not reported."""


def test_entries_of_the_api_have_signatures_and_first_paragraphs() -> None:
    made: Any = SimpleNamespace(
        Thing=Thing, Colour=Colour, Odd=type("Odd", (ValueError,), {"__doc__": "Odd.\n\nMore."})
    )
    lines = list(api._entries(made, ("Thing", "Colour", "Odd")))
    assert lines[:2] == ["### Thing", ""]
    assert list(api._members("Mine", Mine)) == ["- `refill() -> None`: A feature of its own."]
    assert lines[2:5] == ["```text", "Thing(size: float, names: list[str] = ...)", "```"]
    assert "- `Thing.of(text, *, strict=True, **others) -> Thing`: Makes one." in lines
    assert "- `weight`: Its weight." in lines
    assert "- `grow(by=1.5, *, fast, far=False) -> None`: Grows." in lines
    assert not any("_hidden" in line for line in lines)
    assert lines[lines.index("### Colour") + 2 :][:3] == ["A colour.", "", "1 `RED`, 2 `BLUE`."]
    assert lines[lines.index("### Odd") + 2] == "Odd."


def test_long_signature_is_on_lines_of_its_own() -> None:
    def long(
        first_argument_of_it: str, second_argument_of_it: int = 3, *, third_argument_of_it: float
    ) -> dict[str, str]:
        raise NotImplementedError

    assert api._signature("long", long) == (
        "long(\n    first_argument_of_it: str,\n    second_argument_of_it: int = 3,\n    *,\n"
        "    third_argument_of_it: float,\n) -> dict[str, str]"
    )
    assert api._annotation("Annotated[float, Option(absent='x')]") == "float"
    assert api._annotation("Annotated[float, Field(gt=0)]") == "Annotated[float, Field(gt=0)]"


def test_public_name_without_a_group_is_named(monkeypatch: Any) -> None:
    monkeypatch.setattr(inkloop, "__all__", [*inkloop.__all__, "novelty"])
    with pytest.raises(ValueError, match=r"GROUPS and inkloop\.__all__ differ in novelty"):
        api.texts()


def test_rooms_stand_one_storey_above_the_highest_that_they_import(monkeypatch: Any) -> None:
    below = {
        "inkloop.a": set(),
        "inkloop.b": {"inkloop.a"},
        "inkloop.c": {"inkloop.a", "inkloop.b"},
        "inkloop.d": set(),
    }
    monkeypatch.setattr(house, "rooms", lambda: {**below, "inkloop_lab.x": {"inkloop.c"}})
    assert house.storeys() == {"inkloop.a": 0, "inkloop.b": 1, "inkloop.c": 2, "inkloop.d": 0, "inkloop_lab.x": 3}
    assert house.rows("inkloop") == [["inkloop.a", "inkloop.d"], ["inkloop.b"], ["inkloop.c"]]
    places = house.places()
    (left, bottom, width), (beside, level, _) = places["inkloop.a"], places["inkloop.d"]
    assert (bottom, level) == (14.0, 14.0)
    assert (left, beside, width) == (30.3, 50.3, 19.4)
    assert places["inkloop.b"] == (30.3, 14.0 + 4.4, 39.4)
    assert house.ground("inkloop_lab") == pytest.approx(14.0 + 3 * 4.4 + 3.0, rel=1e-9, abs=0.0)


def test_rooms_hide_the_floor_and_the_packages_themselves(monkeypatch: Any) -> None:
    graph = {
        "inkloop": {"inkloop.units"},
        "inkloop.units": set(),
        "inkloop.report.plot": {"inkloop.units", "inkloop", "inkloop.results.result"},
        "inkloop.results.result": {"inkloop.errors"},
        "inkloop.errors": set(),
    }
    monkeypatch.setattr(house, "import_graph", lambda: graph)
    monkeypatch.setattr(house, "modules", lambda: graph)
    found = house.rooms.__wrapped__()
    assert found == {"inkloop.report": {"inkloop.results"}, "inkloop.results": set()}


def test_signals_have_their_limits_units_and_cycles() -> None:
    def signal(length: int, minimum: Any, maximum: Any, unit: Any, scale: float) -> Any:
        return SimpleNamespace(length=length, minimum=minimum, maximum=maximum, unit=unit, scale=scale)

    assert can_protocol._value(signal(1, 0, 1, None, 1)) == "flag"
    assert can_protocol._value(signal(8, None, None, None, 1)) == "bytes"
    assert can_protocol._value(signal(8, -2.5, 10, "mm", 0.5)) == "-2.5 to 10 mm, step 0.5"
    assert can_protocol._value(signal(8, 0, 255, None, 1)) == "0 to 255"
    cycles = [SimpleNamespace(cycle_time=time, send_type=kind) for time, kind in
              ((None, "Cyclic"), (100, "Cyclic"), (1000, "Cyclic"), (2500, "Event"))]  # fmt: skip
    assert [can_protocol._cycle(each) for each in cycles] == [  # type: ignore[arg-type]
        "on request", "100 ms", "1 s", "on event, then 2.5 s while active",
    ]  # fmt: skip


def test_diagram_draws_inputs_from_the_left_and_maps_thick() -> None:
    path = next(path for path in diagrams.DEFINITIONS if path.parent.name == "layer_deposition")
    model = definition.load(definition.text_of(path), path)
    inputs, outputs = (list(diagrams.rows(model, causality)) for causality in ("input", "output"))
    assert any(is_map for *_, is_map in inputs)
    assert ("height", "[m]", True) in outputs
    assert not any("[1]" in kind for _, kind, _ in (*inputs, *outputs))
    axes: Any = diagrams.draw(model).axes[0]
    arrows = [text for text in axes.texts if getattr(text, "arrow_patch", None) is not None]
    width = max(vertex[0] for vertex in axes.patches[0].get_xy())
    begins = [arrow.xyann[0] for arrow in arrows]
    ends = [arrow.xy[0] for arrow in arrows]
    count = sum(not name.endswith(":") for name, *_ in inputs)
    assert (begins[:count], ends[:count]) == ([-0.3] * count, [0.0] * count)
    assert begins[count:] == pytest.approx([width] * (len(arrows) - count), rel=1e-9, abs=0.0)
    assert ends[count:] == pytest.approx([width + 0.3] * (len(arrows) - count), rel=1e-9, abs=0.0)
    thick = [arrow.arrow_patch.get_linewidth() > 1.0 for arrow in arrows]
    assert thick == [is_map for name, _, is_map in (*inputs, *outputs) if not name.endswith(":")]
