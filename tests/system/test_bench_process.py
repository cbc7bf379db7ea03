"""The emulator as a separate process, driven by stock tools."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from struct import pack

import can
import pytest
import udsoncan

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.readiness import NotReady, clear, make_ready
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.errors import NodeRefused
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Frame
from inkloop_hardware.protocol.records import Fault, Node
from inkloop_hardware.protocol.services import ClearOption
from support.benches import node_bench
from support.benches.bench_run import BLOCK, COMMAND, FAST, write
from support.benches.stock_tools import FULL, adapter, print_and_scan, process, read_map, send_pattern, start


@pytest.fixture(scope="module")
def program() -> Path:
    return node_bench.process()


def test_stock_tools_print_cure_scan_and_read_the_journal(program: Path) -> None:
    with (
        process(program, "pass_ms=5", "alive_ms=1000", "watchdog_ms=1000") as (_, channel),
        adapter(channel) as bus,
        bus.client(0) as head,
        bus.client(2) as lamp,
        bus.client(3) as profiler,
        node_bench.NodeBench(nx=9, ny=9, pass_ms=5) as same,
    ):
        print_and_scan(head, lamp, profiler)
        assert start(head, node_bench.Routine.PASS, b"\0") == node_bench.DONE_BEFORE
        journal = head.read_data_by_identifier(0x0110).service_data.values[0x0110]
        assert [journal[at + 4] for at in range(0, len(journal), 40)] == [4, 3, 4, 3, 4, 3, 4, 3, 2, 1]
        same.ready().print_layer(FULL, 1)
        assert same.scan(1) == node_bench.DONE
        assert read_map(profiler, 1) == same.upload(1)


def test_every_adapter_sees_the_frames_of_all_nodes_and_the_dbc_reads_them(program: Path) -> None:
    """Also those of the other adapters."""
    with process(program) as (_, channel), adapter(channel), adapter(channel) as other:
        seen = can.BufferedReader()
        other.notifier.add_listener(seen)
        missing = {0x020, *range(0x101, 0x105), *range(0x111, 0x115)}
        while missing:
            message = seen.get_message(60)
            assert message, f"no frame of {missing}"
            missing.discard(message.arbitration_id)
            if message.arbitration_id < 0x600:
                assert other.codec.decode(Frame(message.arbitration_id, bytes(message.data)))


def test_journal_outlives_a_killed_process(program: Path, tmp_path: Path) -> None:
    arguments = ("pass_ms=20000", "--folder", str(tmp_path))
    with process(program, *arguments) as (running, channel), adapter(channel) as bus, bus.client(0) as head:
        assert start(head, node_bench.Routine.CLEAR, b"\0") == node_bench.DONE
        send_pattern(head, node_bench.pattern_blob(FULL), 1)
        head.conn.send(pack(">BBHIHBBB", 0x31, 1, node_bench.Routine.PASS, 7, 1, 0, 1, 0))
        assert head.conn.wait_frame(timeout=60) == b"\x7f\x31\x78"
        running.kill()
        running.wait()
    with process(program, *arguments) as (_, channel), adapter(channel) as bus, bus.client(0) as head:
        state = head.read_data_by_identifier(0x0100).service_data.values[0x0100]
        assert (state[11], state[12]) == (0, 1), "pass 0 is not done, and unknown"
        with pytest.raises(udsoncan.exceptions.NegativeResponseException, match="ConditionsNotCorrect"):
            start(head, node_bench.Routine.CLEAR, b"\0")
        assert start(head, node_bench.Routine.CLEAR, b"\1") == node_bench.DONE


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of a running process is changed as on Linux")
def test_full_disk_of_the_nodes_is_named_and_the_print_continues_with_room(tmp_path: Path) -> None:
    """No file may grow beyond the journals, which have their size from the start; the surface is larger."""
    import resource

    cells, folder = 60, tmp_path / "nodes"
    with EmulatedBench({"nx": cells, "ny": cells, **FAST}, folder=folder) as bench:
        most = max(path.stat().st_size for path in folder.iterdir())
        assert most < 8 * cells**2
        resource.prlimit(bench.process_id, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
        with Rig(BusSettings("slcan", bench.channel, 500_000)) as rig:
            with pytest.raises(NodeRefused, match=r"home .*it is FAULT \(storage failed\)"):
                make_ready(rig, tuple(Node))
            with pytest.raises(NotReady, match=r"stage: needs .* because of STORAGE_FAILED; make room in its storage"):
                make_ready(rig, tuple(Node))
            assert not list(folder.glob("*.new")), "what could not be written takes no room"
            resource.prlimit(bench.process_id, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            clear(rig, Node.STAGE, ClearOption.OPERATOR)
            make_ready(rig, tuple(Node))


def is_head_booted(frame: can.Message | None, times: int) -> bool:
    assert frame is not None, "the bus is silent"
    return frame.arbitration_id == 0x101 and frame.data[6] == times


def test_process_that_stands_still_with_the_gate_open_is_reset_by_the_watchdog(program: Path) -> None:
    with process(program, "pass_ms=60000") as (running, channel), adapter(channel) as bus, bus.client(0) as head:
        assert start(head, node_bench.Routine.CLEAR, b"\0") == node_bench.DONE
        send_pattern(head, node_bench.pattern_blob(FULL), 1)
        head.conn.send(pack(">BBHIHBBB", 0x31, 1, node_bench.Routine.PASS, 7, 1, 0, 1, 0))
        assert head.conn.wait_frame(timeout=60) == b"\x7f\x31\x78"
        seen = can.BufferedReader()
        bus.notifier.add_listener(seen)
        running.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        running.send_signal(signal.SIGCONT)
        while not is_head_booted(seen.get_message(timeout=60), times=2):
            pass  # a request that comes before the reset gets no answer
        state = head.read_data_by_identifier(0x0100).service_data.values[0x0100]
        assert (state[0], state[1], state[12]) == (0, Fault.PASS_UNKNOWN, 1), "SAFE, pass 0 unknown"
        assert state[3] & 64, "by the watchdog"
        assert (state[16] << 8 | state[17], state[-1]) == (2, 0), "booted twice; the gate did not open again"


def test_terminal_is_a_channel_too(program: Path) -> None:
    with process(program, "--pty") as (_, channel), adapter(channel) as bus, bus.client(3) as profiler:
        assert channel.startswith("/dev/")
        assert start(profiler, node_bench.Routine.CLEAR, b"\0", layer=0) == node_bench.DONE
        assert start(profiler, node_bench.Routine.SCAN, layer=0) == node_bench.DONE
        assert len(read_map(profiler, 0)) == 12 + 2 * 81 + 11


@pytest.mark.parametrize(
    ("argument", "word"),
    [("nx=0", "nx=0"), ("colour=1", "colour=1"), ("--port", "--port"), ("resolution=1.5e-10", "nanometres")],
)
def test_wrong_argument_is_reported_and_nothing_runs(program: Path, argument: str, word: str) -> None:
    ended = subprocess.run([program, argument], capture_output=True, text=True, check=False)
    assert ended.returncode in (1, 2)
    assert word in ended.stderr


def test_process_ends_with_its_parent(program: Path) -> None:
    running = subprocess.Popen([program, "--until-stdin-closes"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    assert running.stdin
    running.stdin.close()
    assert running.wait(timeout=600) == 0


def test_command_lists_the_faults_and_refuses_unknown_ones(tmp_path: Path) -> None:
    path = write(tmp_path, BLOCK + '\n[[bench.faults]]\nkind = "swap"\n')
    words = [*COMMAND, "bench", "emulate", str(path), "--port", "0", "--fault"]
    running = subprocess.Popen([*words, "loss:probability=1e-3"], stdout=subprocess.PIPE, text=True)
    assert running.stdout
    lines = [running.stdout.readline() for _ in range(4)]
    running.send_signal(signal.SIGINT)
    running.communicate(timeout=600)
    assert lines[2:] == ["injected fault: swap\n", "injected fault: loss:probability=0.001\n"]
    wrong = subprocess.run([*words, "lost"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 1
    assert "kind is 'lost'; expected 'loss'" in " ".join(wrong.stderr.split())
