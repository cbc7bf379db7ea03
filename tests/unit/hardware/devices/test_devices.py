"""Printer and profiler of a bench as components: what they ask of the nodes, and in which order.

The nodes are those of the firmware, without a wire between; `tests/system/test_bench_run.py` has the wire.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Ink, Job
from inkloop.errors import ComponentError
from inkloop.testing import CONTRACT_CHECKS, ContractCheck, job
from inkloop_hardware.devices.commands import dry_run
from inkloop_hardware.devices.journal_comparison import JournalsDiffer
from inkloop_hardware.devices.printer import Printer
from inkloop_hardware.devices.profiler import FirstScanError, Profiler
from inkloop_hardware.devices.readiness import NotReady
from inkloop_hardware.protocol.node_state import Flags
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Routine, Station
from inkloop_hardware.protocol.transfer_bytes import PatternBytes
from support.benches import node_bench
from support.benches.node_bench import GATE, LAMP, MOTION, NodeBench
from support.benches.node_rig import FOUR, FULL, NodeRig, bench, print_layer

pytestmark = pytest.mark.compiled

SECOND = 1_000_000_000


def started(component: Any, command: int = 0) -> Any:
    inputs = {port.name: port.start_value() for port in component.inputs}
    component.initialize(0, inputs | {"layer_command": np.int32(command), "layers_printed": np.int32(command)})
    return component


@pytest.mark.parametrize("check", CONTRACT_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("make", [Printer, Profiler], ids=["printer", "profiler"])
def test_devices_keep_the_contract_of_components(
    make: Callable[[Job, NodeRig], Component], check: ContractCheck
) -> None:
    check(lambda: make(FOUR, NodeRig(bench(noise_std=1e-6, sensor_seed=2))))


def test_layer_of_four_passes_is_stage_head_stage_lamp_for_each_colour_in_the_order_of_the_job() -> None:
    part = replace(FOUR, pass_order=2, pass_rotation=1)
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(part, rig, cure_ms=20))
        rig.enables.clear()
        assert print_layer(printer, 1, FULL)["layers_printed"] == 1
        head, stage, cure = (rig.link(node).asked for node in (Node.HEAD, Node.STAGE, Node.CURE))
        assert [option[0] for routine, _, option in head if routine == Routine.PASS] == [3, 1, 2, 0]
        moves = [option[0] for routine, _, option in stage if routine == Routine.MOVE]
        assert moves == [Station.PRINT, Station.CURE] * 4
        assert [option for routine, _, option in cure if routine == Routine.CURE] == [b"\x00\x14"] * 4
        assert rig.enables == [MOTION, GATE | MOTION, MOTION, LAMP] * 4
        assert rig.bench.master.enables == 0
        assert nodes.gate_openings == nodes.lamp_pulses == 4
        assert nodes.lamp_with_gate == 0


def test_pattern_goes_coded_where_that_is_shorter_and_plain_to_a_head_that_does_not_take_it() -> None:
    part = replace(job(40, 40), passes=4)
    dithered = np.random.default_rng(1).integers(0, 2, (40, 40))
    with bench(part) as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(part, rig, cure_ms=5))
        print_layer(printer, 1, np.ones((part.nx, part.ny), np.int32))
        print_layer(printer, 2, dithered)
        rig.takes_coded = False
        print_layer(printer, 3, np.ones((part.nx, part.ny), np.int32))
        assert rig.downloads == [(1, True), (2, False), (3, False)]


def test_scan_is_asked_for_once_a_layer_and_only_when_there_is_a_new_one() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        profiler = started(Profiler(FOUR, rig))
        for layer in (0, 0, 0):
            profiler.do_step(0, SECOND, {"layers_printed": np.asarray(layer, np.int32)})
        assert [routine for routine, *_ in rig.link(Node.PROFILER).asked].count(Routine.SCAN) == 1


def test_later_layer_finished_before_the_run_knew_is_not_printed_again() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        print_layer(first, 1, FULL)
        saved = first.save()
        print_layer(first, 2, FULL)
        second = started(Printer(FOUR, rig, cure_ms=5))
        second.restore(saved)
        assert print_layer(second, 2, FULL)["layers_printed"] == 2
        assert nodes.gate_openings == 8


def print_two_passes(nodes: NodeBench, rig: NodeRig) -> None:
    """By hand, as an interrupted printer leaves it."""
    blob = PatternBytes.of(FULL, passes=4, materials=1)
    nodes.master = node_bench.MasterAlive(LAMP | GATE | MOTION, 1, rig.job)
    nodes.send_keep_alive()
    assert nodes.download(blob.coded, 1, coded=0x10) == 0
    for number in range(2):
        assert nodes.run(node_bench.Routine.PASS, layer=1, which=number, option=bytes([number]), job=rig.job) == 0


def test_unknown_pass_asks_for_a_person_then_the_layer_is_cured_as_it_is() -> None:
    """The next scan shows what it became; nothing more is jetted in it."""
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        saved = first.save()
        print_two_passes(nodes, rig)
        nodes.raw(nodes.routine(node_bench.Routine.PASS, layer=1, which=2, option=b"\2", job=rig.job))
        nodes.tick(5)
        nodes.power_up(node_bench.HEAD)
        with pytest.raises(NotReady, match=r"pass 3 of layer 1.*progress is unknown.*inkloop bench clear SCENARIO"):
            started(Printer(FOUR, rig))
        rig.link(Node.HEAD).routine(Routine.CLEAR, Key(rig.job, 0), b"\1", limit_s=1)
        openings, pulses = nodes.gate_openings, nodes.lamp_pulses
        second = started(Printer(FOUR, rig, cure_ms=5))
        second.restore(saved)
        assert print_layer(second, 1, FULL)["layers_printed"] == 1
        assert nodes.gate_openings == openings
        assert nodes.lamp_pulses == pulses + 3
        assert print_layer(second, 2, FULL)["layers_printed"] == 2


def test_head_that_printed_something_else_since_is_refused_with_a_message() -> None:
    with bench() as nodes:
        first = started(Printer(FOUR, NodeRig(nodes, job=7), cure_ms=5))
        print_layer(first, 1, FULL)
        saved = first.save()
        other = started(Printer(FOUR, NodeRig(nodes, job=8), cure_ms=5))
        print_layer(other, 1, FULL)
        again = started(Printer(FOUR, NodeRig(nodes, job=9), cure_ms=5))
        with pytest.raises(JournalsDiffer, match=r"layer 1 of job 8.* layer 1 of job 7.*inkloop run"):
            again.restore(saved)


@pytest.mark.parametrize("make", [Printer, Profiler])
def test_bytes_that_are_no_state_are_refused_with_a_message(make: Callable[[Job, NodeRig], Component]) -> None:
    with bench() as nodes, pytest.raises(ComponentError, match="the saved state is not one of this"):
        started(make(FOUR, NodeRig(nodes))).restore(b"abc")


def test_restored_profiler_repeats_the_last_scan_without_scanning() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Profiler(FOUR, rig))
        nodes.surface[:] = 3e-6
        found = first.do_step(0, SECOND, {"layers_printed": np.int32(0)})
        other = NodeRig(nodes, job=8)
        second = started(Profiler(FOUR, other))
        second.restore(first.save())
        assert other.job == rig.job
        nodes.surface[:] = 9e-6
        again = second.do_step(0, SECOND, {"layers_printed": np.int32(0)})
        for name, value in found.items():
            np.testing.assert_array_equal(again[name], value)
        assert Routine.SCAN not in [routine for routine, *_ in other.link(Node.PROFILER).asked]


def test_profiler_saved_before_its_first_scan_has_none_when_restored() -> None:
    with bench() as nodes:
        profiler = started(Profiler(FOUR, NodeRig(nodes)))
        saved = profiler.save()
        profiler.do_step(0, SECOND, {"layers_printed": np.int32(0)})
        profiler.restore(saved)
        assert profiler._outputs()["layers_scanned"] == -1


def test_profiler_scans_the_newest_layer_however_many_there_are_since() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        profiler = started(Profiler(FOUR, rig))
        for layer in (0, 3):
            found = profiler.do_step(0, SECOND, {"layers_printed": np.int32(layer)})
            assert found["layers_scanned"] == layer
        scans = [key for routine, key, _ in rig.link(Node.PROFILER).asked if routine == Routine.SCAN]
        assert scans == [Key(rig.job, layer) for layer in (0, 3)]


def test_droplets_are_counted_by_material_and_a_job_of_32_bits_is_saved() -> None:
    part = replace(FOUR, inks=(Ink(), Ink()))
    pattern = np.zeros((part.nx, part.ny), np.int32)
    pattern[1, :3], pattern[2, :2] = 1, 2
    level = np.where(pattern > 0, 1, 5)  # where no droplet falls it counts for nothing
    with bench() as nodes:
        rig = NodeRig(nodes, job=2**32 - 1)
        printer = started(Printer(part, rig, cure_ms=5))
        given = {"pattern": pattern, "drop_level": level, "layer_command": np.int32(1)}
        found = printer.do_step(0, SECOND, given)
        assert (found["droplets_a"], found["droplets_b"]) == (3, 2)
        again = NodeRig(nodes, job=8)
        second = started(Printer(part, again), 1)
        second.restore(printer.save())
        assert again.job == 2**32 - 1
        assert second.do_step(0, SECOND, given) == found


def test_dry_run_enables_nothing_but_motion() -> None:
    """A node in a dry run moves neither gate nor lamp; the master does not allow it either."""
    with bench() as nodes:
        rig = NodeRig(nodes)
        rig.attach()
        assert list(dry_run(rig, FOUR, cure_ms=5)) == [
            "a layer of 15 droplets in 4 passes: all steps went through, nothing was jetted or lit",
            "its scan: 7 x 5 cells, 100% of them valid",
        ]
        lit = [option for routine, _, option in rig.link(Node.CURE).asked if routine == Routine.CURE]
        assert lit == 4 * [b"\x00\x05"]
        assert set(rig.enables) == {0, MOTION}
        assert nodes.gate_openings == nodes.lamp_pulses == 0
        assert not nodes.surface.any()
        assert not any(rig.link(node).state().flags & Flags.DRY_RUN for node in Node)


def test_scan_of_a_dry_run_must_see_the_bed_and_one_pass_is_called_so() -> None:
    one = job()
    with bench(one, dropout_rate=0.5, sensor_seed=1) as nodes:
        rig = NodeRig(nodes)
        rig.attach()
        rig.valid_share = 0.9
        lines: list[str] = []
        with pytest.raises(FirstScanError, match=r"^the scan: \d\d% of its cells are valid; needs 90% "):
            lines.extend(dry_run(rig, one, cure_ms=5))
        assert lines[0].startswith("a layer of 15 droplets in one pass: all steps")
        assert not any(rig.link(node).state().flags & Flags.DRY_RUN for node in Node)


def test_droplets_of_all_layers_are_counted_also_in_one_pass_and_begin_anew_with_a_run() -> None:
    part = job()
    sparse = np.zeros((part.nx, part.ny), np.int32)
    sparse[2, 1:4] = 1
    with bench(part) as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(part, rig, cure_ms=5))
        counts = [int(print_layer(printer, layer, one)["droplets_a"]) for layer, one in ((1, FULL), (2, sparse))]
        assert counts == [35, 38]
        again = printer.initialize(0, {"layer_command": np.int32(2)})
        assert (int(again["droplets_a"]), int(again["layers_printed"])) == (0, 2)


def test_drop_level_counts_for_either_material() -> None:
    part = replace(FOUR, inks=(Ink(), Ink()))
    pattern = np.zeros((part.nx, part.ny), np.int32)
    pattern[1, 1], pattern[2, 2] = 1, 2
    for cell in ((1, 1), (2, 2)):
        level = np.ones_like(pattern)
        level[cell] = 2
        with bench(part) as nodes:
            printer = started(Printer(part, NodeRig(nodes)))
            given = {"pattern": pattern, "drop_level": level, "layer_command": np.int32(1)}
            with pytest.raises(ComponentError, match="drop_level is not 1"):
                printer.do_step(0, SECOND, given)


def test_run_is_resumed_where_the_head_has_its_layer_or_the_next_one() -> None:
    """A run that has printed nothing may begin whatever the head had before."""
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        states = [first.save()]
        for layer in (1, 2, 3):
            print_layer(first, layer, FULL)
            states.append(first.save())
        for printed, may in enumerate((True, False, True, True)):
            again = started(Printer(FOUR, rig, cure_ms=5))
            if may:
                again.restore(states[printed])
            else:
                with pytest.raises(JournalsDiffer, match="layer 3 of job 7, this run was at layer 1 of job 7:"):
                    again.restore(states[printed])


def test_unknown_layer_is_forgotten_by_a_new_run() -> None:
    with bench() as nodes:
        printer = started(Printer(FOUR, NodeRig(nodes)))
        printer._is_unknown = True
        saved = printer.save()
        printer.restore(saved)
        assert printer._outputs()["layer_unknown"]
        assert not printer.initialize(0, {"layer_command": np.int32(0)})["layer_unknown"]


def test_first_scan_of_a_profiler_is_checked_and_no_later_one() -> None:
    with bench(dropout_rate=0.5, sensor_seed=1) as nodes:
        rig = NodeRig(nodes)
        profiler = started(Profiler(FOUR, rig))
        rig.valid_share = 0.9
        with pytest.raises(FirstScanError, match=r"^the first scan: "):
            profiler.do_step(0, SECOND, {"layers_printed": np.int32(0)})
        rig.valid_share = 0.0
        assert profiler.do_step(0, SECOND, {"layers_printed": np.int32(0)})["layers_scanned"] == 0
        rig.valid_share = 0.9
        assert profiler.do_step(0, SECOND, {"layers_printed": np.int32(1)})["layers_scanned"] == 1


def test_zero_of_the_stage_is_logged_where_it_was_looked_for(caplog: pytest.LogCaptureFixture) -> None:
    """The second device of a rig finds it homed."""
    caplog.set_level(logging.INFO, "inkloop_hardware")
    with bench() as nodes:
        rig = NodeRig(nodes)
        for device in (Printer(FOUR, rig), Profiler(FOUR, rig)):
            started(device)
    assert caplog.messages == ["stage: at its zero"]


def test_first_step_of_a_new_run_scans_again() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        profiler = started(Profiler(FOUR, rig))
        for _ in range(2):
            assert started(profiler)._outputs()["layers_scanned"] == -1
            assert profiler.do_step(0, SECOND, {"layers_printed": np.int32(0)})["layers_scanned"] == 0
        assert [routine for routine, *_ in rig.link(Node.PROFILER).asked].count(Routine.SCAN) == 2


def test_dry_run_left_over_is_ended_before_a_real_layer() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        started(Printer(FOUR, rig))
        assert nodes.run(node_bench.Routine.DRY_RUN, node_bench.HEAD, option=b"\1", job=rig.job) == 0
        print_layer(started(Printer(FOUR, rig, cure_ms=5)), 1, FULL)
        assert nodes.surface.any()


@pytest.mark.parametrize(
    ("inputs", "word"),
    [
        ({"layer_command": np.int32(2)}, "layer_command is 2 after layer 0; needs 0 or 1"),
        ({"layer_command": np.int32(-1)}, "needs 0 or 1"),
        ({"drop_level": 2 * FULL}, "drop_level is not 1"),
        ({"pattern": 2 * FULL}, "0 to 1"),
    ],
)
def test_what_the_head_cannot_do_is_refused_and_nothing_moves(inputs: dict[str, Any], word: str) -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(FOUR, rig))
        given = {"layer_command": np.int32(1), "drop_level": FULL, "pattern": FULL} | inputs
        before = len(rig.link(Node.STAGE).asked)
        with pytest.raises(ComponentError, match=word):
            printer.do_step(0, SECOND, given)
        assert len(rig.link(Node.STAGE).asked) == before
        assert not nodes.surface.any()


def test_rig_is_left_once_by_each_device_also_when_it_never_began() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer, profiler, unused = Printer(FOUR, rig), Profiler(FOUR, rig), Printer(FOUR, rig)
        for device in (printer, profiler):
            started(device)
        for device in (printer, profiler, unused, printer):
            device.terminate()
        assert rig.users == 0
