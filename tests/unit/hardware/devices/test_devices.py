"""Printer and profiler of a bench as components: what they ask of the nodes, and in which order.

The nodes are those of the firmware, without a wire between; `tests/system/test_bench_run.py` has the wire.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Ink, Job, is_device
from inkloop.errors import ComponentError
from inkloop.testing import CONTRACT_CHECKS, ContractCheck, job
from inkloop_hardware.devices.commands import dry_run
from inkloop_hardware.devices.printer import Printer
from inkloop_hardware.devices.profiler import Profiler
from inkloop_hardware.devices.readiness import NotReady
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.protocol.node_state import Flags
from inkloop_hardware.protocol.pattern_bytes import PatternBytes
from inkloop_hardware.protocol.services import Key, Routine, Station
from inkloop_hardware.protocol.vocabulary import Node
from support.benches import node_bench
from support.benches.node_bench import GATE, LAMP, MOTION, NodeBench
from support.benches.node_rig import NodeRig
from support.fmus.fmu_driver import OK, Driver

pytestmark = pytest.mark.compiled

SECOND = 1_000_000_000
FOUR = replace(job(), passes=4)


def bench(part: Job = FOUR, **options: Any) -> NodeBench:
    return NodeBench(nx=part.nx, ny=part.ny, pass_ms=5, scan_ms=5, **options)


def started(component: Any, command: int = 0) -> Any:
    inputs = {port.name: port.start_value() for port in component.inputs}
    component.initialize(0, inputs | {"layer_command": np.int32(command), "layers_printed": np.int32(command)})
    return component


def print_layer(printer: Component, layer: int, pattern: np.ndarray) -> int:
    """Layers printed afterwards."""
    ones = np.ones(pattern.shape, np.int32)
    inputs = {"pattern": pattern.astype(np.int32), "drop_level": ones, "layer_command": np.asarray(layer, np.int32)}
    return int(printer.do_step(0, SECOND, inputs)["layers_printed"])


def full(part: Job = FOUR) -> np.ndarray:
    return np.ones((part.nx, part.ny), np.int32)


@pytest.mark.parametrize("check", CONTRACT_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("make", [Printer, Profiler], ids=["printer", "profiler"])
def test_devices_keep_the_contract_of_components(
    make: Callable[[Job, NodeRig], Component], check: ContractCheck
) -> None:
    check(lambda: make(FOUR, NodeRig(bench(noise_std=1e-6, sensor_seed=2))))


def test_devices_are_marked_as_such_and_neither_report_nor_take_a_height() -> None:
    for device in (Printer(FOUR, NodeRig(bench())), Profiler(FOUR, NodeRig(bench()))):
        assert is_device(device)
        assert "height" not in {port.name for port in (*device.inputs, *device.outputs)}


def test_layer_of_four_passes_is_stage_head_stage_lamp_for_each_colour_in_the_order_of_the_job() -> None:
    part = replace(FOUR, pass_order=2, pass_rotation=1)
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(part, rig, cure_ms=20))
        rig.enables.clear()
        assert print_layer(printer, 1, full()) == 1
        head, stage, cure = (rig.link(node).asked for node in (Node.HEAD, Node.STAGE, Node.CURE))
        assert [option[0] for routine, _, option in head if routine == Routine.PASS] == [3, 1, 2, 0]
        moves = [option[0] for routine, _, option in stage if routine == Routine.MOVE]
        assert moves == [Station.PRINT, Station.CURE] * 4
        assert [option for routine, _, option in cure if routine == Routine.CURE] == [b"\x00\x14"] * 4
        assert rig.enables == [MOTION, GATE | MOTION, MOTION, LAMP] * 4
        assert rig.bench.master.enables == 0
        assert nodes.gate_openings == nodes.lamp_pulses == 4
        assert nodes.lamp_with_gate == 0


def test_layer_of_one_pass_jets_all_colours_at_once() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        print_layer(started(Printer(job(), rig)), 1, full())
        assert [option for routine, _, option in rig.link(Node.HEAD).asked if routine == Routine.PASS] == [b"\xff"]


@pytest.mark.parametrize("passes", [1, 4])
@pytest.mark.parametrize("inks", [1, 2])
def test_three_layers_give_the_maps_of_the_fmus_bit_for_bit(passes: int, inks: int) -> None:
    part = replace(job(11, 9), passes=passes, pass_order=2, pass_rotation=1, inks=(Ink(), Ink(h1=3.9e-6))[:inks])
    patterns = np.random.default_rng(5).integers(0, inks + 1, (3, part.nx, part.ny)).astype(np.int32)
    sensor = {"noise_std": 0.5e-6, "dropout_rate": 0.1, "resolution": 1e-7}
    shared = {"variation": 0.2, "variation_kind": 1, "h1_b": 3.9e-6}
    process = {"passes": passes, "pass_order": 2, "pass_rotation": 1, "seed": 4}
    with (
        bench(part, printer_seed=4, sensor_seed=6, **sensor, **shared) as nodes,
        Driver("LayerDeposition", nx=11, ny=9).start(shared | process) as plant,
        Driver("ProfileSensor", nx=11, ny=9).start(sensor | {"seed": 6, "scan_duration": 0.0}) as eye,
    ):
        rig = NodeRig(nodes)
        printer, profiler = started(Printer(part, rig, cure_ms=5)), started(Profiler(part, rig))
        surface = np.zeros((11, 9))
        for layer in range(4):
            if layer > 0:
                assert print_layer(printer, layer, patterns[layer - 1]) == layer
                surface = plant.print_layer(patterns[layer - 1])
            found = profiler.do_step(0, SECOND, {"layers_printed": np.asarray(layer, np.int32)})
            eye.set("height", surface)
            eye.set("layers_printed", layer)
            assert eye.step(float(layer)) == OK
            assert found["layers_scanned"] == layer
            np.testing.assert_array_equal(found["valid"], eye.get("valid"))
            np.testing.assert_array_equal(found["measured_height"], eye.get("measured_height"))


def test_pattern_goes_coded_where_that_is_shorter_and_plain_to_a_head_that_does_not_take_it() -> None:
    part = replace(job(40, 40), passes=4)
    dithered = np.random.default_rng(1).integers(0, 2, (40, 40))
    with bench(part) as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(part, rig, cure_ms=5))
        print_layer(printer, 1, full(part))
        print_layer(printer, 2, dithered)
        rig.takes_coded = False
        print_layer(printer, 3, full(part))
        assert rig.downloads == [(1, True), (2, False), (3, False)]


def test_scan_is_asked_for_once_a_layer_and_only_when_there_is_a_new_one() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        profiler = started(Profiler(FOUR, rig))
        for layer in (0, 0, 0):
            profiler.do_step(0, SECOND, {"layers_printed": np.asarray(layer, np.int32)})
        assert [routine for routine, *_ in rig.link(Node.PROFILER).asked].count(Routine.SCAN) == 1


def test_interrupted_layer_is_resumed_and_no_pass_is_jetted_twice() -> None:
    """The master dies after two passes; another one takes up its job."""
    with bench(variation=0.2, printer_seed=3) as nodes, bench(variation=0.2, printer_seed=3) as same:
        print_layer(started(Printer(FOUR, NodeRig(same), cure_ms=5)), 1, full())
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        saved = first.save()
        head = rig.link(Node.HEAD)
        ask = head.routine

        def dies(routine: Routine, *rest: Any, **more: Any) -> Any:
            if routine == Routine.PASS and len([a for a in head.asked if a[0] == Routine.PASS]) == 2:
                raise KeyboardInterrupt
            return ask(routine, *rest, **more)

        head.routine = dies
        with pytest.raises(KeyboardInterrupt):
            print_layer(first, 1, full())
        assert nodes.master.enables == 0
        again = NodeRig(nodes, job=8)
        second = started(Printer(FOUR, again, cure_ms=5))
        second.restore(saved)
        assert print_layer(second, 1, full()) == 1
        assert again.downloads == []
        assert nodes.gate_openings == 4
        np.testing.assert_array_equal(nodes.surface, same.surface)


def test_layer_finished_before_the_run_knew_is_not_printed_again() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        saved = first.save()
        print_layer(first, 1, full())
        second = started(Printer(FOUR, rig, cure_ms=5))
        second.restore(saved)
        assert print_layer(second, 1, full()) == 1
        assert nodes.gate_openings == 4


def test_later_layer_finished_before_the_run_knew_is_not_printed_again() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        print_layer(first, 1, full())
        saved = first.save()
        print_layer(first, 2, full())
        second = started(Printer(FOUR, rig, cure_ms=5))
        second.restore(saved)
        assert print_layer(second, 2, full()) == 2
        assert nodes.gate_openings == 8


def test_rebooted_head_gets_its_pattern_again_and_continues_by_its_journal() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        first = started(Printer(FOUR, rig, cure_ms=5))
        saved = first.save()
        print_two_passes(nodes, rig)
        nodes.power_up(node_bench.HEAD)
        second = started(Printer(FOUR, rig, cure_ms=5))
        second.restore(saved)
        assert print_layer(second, 1, full()) == 1
        assert rig.downloads == [(1, True)]
        assert nodes.gate_openings == 4


def print_two_passes(nodes: NodeBench, rig: NodeRig) -> None:
    """By hand, as an interrupted printer leaves it."""
    blob = PatternBytes.of(full(), passes=4, materials=1)
    nodes.master = node_bench.MasterAlive(LAMP | GATE | MOTION, 1, rig.job)
    nodes.send_keep_alive()
    assert nodes.download(blob.coded, 1, coded=0x10) == 0
    for number in range(2):
        assert nodes.run(node_bench.Routine.PASS, layer=1, which=number, option=bytes([number]), job=rig.job) == 0


def test_layer_begun_with_another_pattern_is_refused_with_a_message() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(FOUR, rig, cure_ms=5))
        print_two_passes(nodes, rig)
        with pytest.raises(HardwareError, match=r"another pattern .* was the scenario changed"):
            print_layer(printer, 1, np.eye(*full().shape))


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
        assert print_layer(second, 1, full()) == 1
        assert nodes.gate_openings == openings
        assert nodes.lamp_pulses == pulses + 3
        assert print_layer(second, 2, full()) == 2


def test_head_that_printed_something_else_since_is_refused_with_a_message() -> None:
    with bench() as nodes:
        first = started(Printer(FOUR, NodeRig(nodes, job=7), cure_ms=5))
        print_layer(first, 1, full())
        saved = first.save()
        other = started(Printer(FOUR, NodeRig(nodes, job=8), cure_ms=5))
        print_layer(other, 1, full())
        again = started(Printer(FOUR, NodeRig(nodes, job=9), cure_ms=5))
        with pytest.raises(ComponentError, match=r"layer 1 of job 8.* layer 1 of job 7.*inkloop run"):
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


def test_profiler_scans_the_newest_layer_however_many_there_are_since() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        profiler = started(Profiler(FOUR, rig))
        for layer in (0, 3):
            found = profiler.do_step(0, SECOND, {"layers_printed": np.int32(layer)})
            assert found["layers_scanned"] == layer
        scans = [key for routine, key, _ in rig.link(Node.PROFILER).asked if routine == Routine.SCAN]
        assert scans == [Key(rig.job, layer) for layer in (0, 3)]


@pytest.mark.parametrize("make", [Printer, Profiler])
def test_each_step_of_a_device_keeps_the_heartbeat_alive(make: Callable[[Job, NodeRig], Component]) -> None:
    """Also one in which nothing is to be done."""
    with bench() as nodes:
        rig = NodeRig(nodes)
        device = started(make(FOUR, rig))
        inputs = {port.name: port.start_value() for port in device.inputs} | {"layers_printed": np.int32(-1)}
        for times in (1, 2):
            device.do_step(0, SECOND, inputs)
            assert rig.kept_alive == times


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
        assert list(dry_run(rig, FOUR, cure_ms=5))
        assert set(rig.enables) == {0, MOTION}
        assert nodes.gate_openings == nodes.lamp_pulses == 0
        assert not nodes.surface.any()


def test_dry_run_is_over_in_every_node_when_it_has_ended() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        rig.attach()
        assert list(dry_run(rig, FOUR, cure_ms=5))
        assert not any(rig.link(node).state().flags & Flags.DRY_RUN for node in Node)


def test_dry_run_left_over_is_ended_before_a_real_layer() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        started(Printer(FOUR, rig))
        assert nodes.run(node_bench.Routine.DRY_RUN, node_bench.HEAD, option=b"\1", job=rig.job) == 0
        print_layer(started(Printer(FOUR, rig, cure_ms=5)), 1, full())
        assert nodes.surface.any()


@pytest.mark.parametrize(
    ("inputs", "word"),
    [
        ({"layer_command": np.int32(2)}, "layer_command is 2 after layer 0; needs 0 or 1"),
        ({"layer_command": np.int32(-1)}, "needs 0 or 1"),
        ({"drop_level": 2 * full()}, "drop_level is not 1"),
        ({"pattern": 2 * full()}, "0 to 1"),
    ],
)
def test_what_the_head_cannot_do_is_refused_and_nothing_moves(inputs: dict[str, Any], word: str) -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(Printer(FOUR, rig))
        given = {"layer_command": np.int32(1), "drop_level": full(), "pattern": full()} | inputs
        before = len(rig.link(Node.STAGE).asked)
        with pytest.raises(ComponentError, match=word):
            printer.do_step(0, SECOND, given)
        assert len(rig.link(Node.STAGE).asked) == before
        assert not nodes.surface.any()


def test_light_longer_than_the_lamp_allows_is_reported_before_anything_is_printed() -> None:
    with bench(lamp_limit_ms=50) as nodes, pytest.raises(NotReady, match=r"cure_ms is 80.*50 ms"):
        started(Printer(FOUR, NodeRig(nodes), cure_ms=80))


def test_rig_is_left_once_by_each_device_also_when_it_never_began() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer, profiler, unused = Printer(FOUR, rig), Profiler(FOUR, rig), Printer(FOUR, rig)
        for device in (printer, profiler):
            started(device)
        for device in (printer, profiler, unused, printer):
            device.terminate()
        assert rig.users == 0
