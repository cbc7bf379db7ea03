"""Adapters that are unplugged, bus-off, or will not take a frame: what the master does, between real processes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inkloop.bench.commands import emulation_of
from inkloop.errors import ComponentError
from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.errors import BusDisconnected, BusError, NodeLost, NodeRefused
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.records import Fault, Node, State
from inkloop_hardware.protocol.services import Outcome
from support.benches.bench_run import FAST, assert_same_print, printed_with_fmus, write
from support.benches.fault_run import BLOB, LIMIT_S, faulty, printed, settings_of, wait_until

ALL = (0, 1, 2, 3)
EXACT = {"part.height_um": 6.0, "components.profiler": {"noise_std_um": 0.0, "dropout_rate": 0.0}}


@pytest.mark.parametrize(
    "fault",
    [
        "unplugged:step=download,layer=2",
        *(
            pytest.param(fault, marks=pytest.mark.long)
            for fault in (
                "unplugged:step=scan,layer=2,count=3",
                "bus-off:step=move,layer=2,pass=2",
                "unplugged:step=move,layer=2,pass=1",
                "reboot:node=head,step=move,layer=2,pass=1",
                "death:node=cure,step=move,layer=2,pass=1,frames=5",
                "loss:probability=0.005",
            )
        ),
    ],
)
def test_print_continues_automatically_where_no_step_is_unknown(fault: str, tmp_path: Path) -> None:
    """The nodes fall to SAFE meanwhile; the run is that of the FMUs, bit for bit."""
    path = write(tmp_path)
    emulation = emulation_of(Scenario.load(path, EXACT))
    with EmulatedBench(emulation.parameters | FAST, surface=emulation.surface, faults=[fault]) as bench:
        found = print_part(Scenario.load(path, {"bench.channel": bench.channel, **EXACT}), folder=tmp_path / "run")
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_unplugged_adapter_is_opened_again_and_nothing_is_enabled_automatically() -> None:
    """The lamp is on when it goes: the node puts it out, and a person is asked for."""
    with faulty("unplugged:step=cure,pass=1,nth=3,count=3") as run:
        run.print_layer(1)
        run.jet(1)
        with pytest.raises(BusDisconnected, match=r"cannot be read any more: .*unplugged.*being opened again"):
            run.cure(1, milliseconds=8000)
        wait_until(lambda: run.rig.keep_alive() is None and not run.rig.supervision.bus.disconnected)
        run.rig.wait_for(Node, LIMIT_S)
        cure, times = run.state(Node.CURE), run.rig.link(Node.CURE).times()
        assert cure.state is State.SAFE
        assert cure.cause in (Fault.MASTER_LOST, Fault.ENABLE_DROPPED)  # whichever the node notices first
        assert times.lamp_on < times.lamp_off < times.lamp_on + 8.0
        with pytest.raises(NodeRefused, match="person"):
            run.clear()
        run.clear(1)
        assert run.cure(1) is Outcome.DONE
        run.rig.link(Node.HEAD).download(1, BLOB)
        for number in (2, 3):
            run.jet(number)
            run.cure(number)
        assert run.state().gate_pulses == 4
        np.testing.assert_allclose(run.scan(), printed(ALL), atol=1e-12)


def test_adapter_that_does_not_come_back_is_given_up_with_a_message() -> None:
    with faulty("unplugged:step=download,count=1000000", reopen_s=1.0) as run:
        with pytest.raises(BusError, match="unplugged"):
            run.rig.link(Node.HEAD).download(1, BLOB)
        with pytest.raises(BusError, match=r"unplugged.*could not be opened again within [12] s"):
            wait_until(lambda: run.rig.keep_alive() is not None)


@pytest.mark.long
def test_terminal_that_is_unplugged_is_given_up_with_a_message(tmp_path: Path) -> None:
    """Its device is gone for good, and so is what it was called."""
    path = write(tmp_path)
    emulation = emulation_of(Scenario.load(path, EXACT))
    faults = ["unplugged:step=download,layer=2"]
    with EmulatedBench(emulation.parameters | FAST, terminal=True, surface=emulation.surface, faults=faults) as bench:
        scenario = Scenario.load(path, {"bench.channel": bench.channel, **EXACT})
        with pytest.raises(ComponentError, match=rf"printer failed .*after layer 1.*{bench.channel}"):
            print_part(scenario, folder=tmp_path / "run")


def test_bench_that_is_gone_is_given_up_with_a_message() -> None:
    with faulty(reopen_s=0.5) as run:
        run.bench.kill()
        with pytest.raises(BusError, match="could not be opened again"):
            wait_until(lambda: run.rig.keep_alive() is not None)


def test_bus_off_is_left_once_and_only_once() -> None:
    with faulty("bus-off:step=download,count=2") as run:
        with pytest.raises(BusDisconnected, match=r"refuses every frame and receives none: bus-off.*termination"):
            run.rig.link(Node.HEAD).download(1, BLOB)
        with pytest.raises(BusError, match="opened again once already"):
            wait_until(lambda: run.rig.keep_alive() is not None)


def test_bus_off_with_the_lamp_enabled_is_left_to_a_person() -> None:
    with faulty("bus-off:step=cure,pass=0,nth=1") as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        run.jet(0)
        with pytest.raises((BusError, NodeLost), match=r"silent|bus-off"):
            run.cure(0, milliseconds=8000)
        with pytest.raises(BusError, match="lamp was enabled, so it is not opened again automatically"):
            wait_until(lambda: run.rig.keep_alive() is not None)


PLUGIN = '''
"""An adapter whose transmit queue is full now and then."""
import errno
import can
from inkloop_hardware.bus.slcan_bus import BulkSlcanBus


class FullNowAndThen(BulkSlcanBus):
    def __init__(self, channel, every=5, timeout=False, **options):
        super().__init__(channel, **options)
        self._every, self._timeout, self._asked = every, timeout, 0

    def send(self, msg, timeout=None):
        self._asked += 1
        if self._every == 0 or self._asked % self._every == 0:
            if self._timeout:
                raise can.CanTimeoutError("write timeout")
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        super().send(msg, timeout)
'''


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The interface "full-queue" of python-can, as a third-party package adds it; known to the bus process."""
    (tmp_path / "full_queue.py").write_text(PLUGIN)
    about = tmp_path / "full_queue-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: full-queue\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[can.interface]\nfull-queue = full_queue:FullNowAndThen\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "full-queue"


@pytest.mark.parametrize(
    "timeout", [False, pytest.param(True, marks=pytest.mark.long)], ids=["ENOBUFS", "write timeout"]
)
def test_frame_that_is_not_taken_is_sent_again(plugin: str, timeout: bool, caplog: pytest.LogCaptureFixture) -> None:
    with faulty() as run:
        run.rig.detach()
        options = {"every": 5, "timeout": timeout, "sleep_after_open": 0.0}
        run.rig.settings = replace(settings_of(run.bench), interface=plugin, options=options)
        run.rig.attach()
        run.clear()
        run.print_layer()
        assert run.state().gate_pulses == 4
        np.testing.assert_allclose(run.scan(), printed(ALL), atol=1e-12)
        wait_until(lambda: run.rig.keep_alive() is None and "frames sent again so far" in caplog.text)


def test_adapter_that_never_takes_a_frame_is_reported(plugin: str) -> None:
    with EmulatedBench({}) as bench:
        settings = BusSettings(plugin, bench.channel, 500_000, {"every": 0, "sleep_after_open": 0.0})
        words = "accepts no frame for 1 s .*could not be opened again"
        with Rig(replace(settings, reopen_s=0.2)) as rig, pytest.raises(BusError, match=words):
            wait_until(lambda: rig.keep_alive() is not None)
