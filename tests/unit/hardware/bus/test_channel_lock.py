"""One mapped rig at a time prints on a channel of this machine."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings, holder, interface_of, lock_channel
from inkloop_hardware.doctor.doctor import examine
from inkloop_hardware.doctor.findings import Grade
from inkloop_hardware.doctor.status import check_second_reader
from inkloop_hardware.errors import AnotherMaster, BusError
from support.other_process import other_process

HOLDING = """
import sys, tempfile
tempfile.tempdir = sys.argv[1]
from inkloop_hardware.bus.settings import lock_channel
from inkloop_hardware.bus.settings import BusSettings
release = lock_channel(BusSettings(interface="socketcan", channel="can0", bitrate=500000))
print("held", flush=True)
sys.stdin.read()
"""
CAN0 = BusSettings(interface="socketcan", channel="can0")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_channel_that_another_process_has_is_refused_until_that_ends(folder: Path) -> None:
    with other_process(HOLDING, str(folder)) as process:
        with pytest.raises(AnotherMaster, match=rf"can0: another inkloop prints there \(process {process.pid} since"):
            lock_channel(CAN0)
        lock_channel(BusSettings(interface="socketcan", channel="can1"))()
        assert (holder(CAN0) or "").startswith(f"process {process.pid} since")
    assert holder(CAN0) is None
    lock_channel(CAN0)()


def test_lock_may_be_taken_by_any_user_later(folder: Path) -> None:
    lock_channel(CAN0)()
    assert [path.stat().st_mode & 0o777 for path in folder.glob("inkloop-channel-*.lock")] == [0o666]


def test_lock_that_cannot_be_written_is_an_error_of_the_bus(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(folder / "missing"))
    with pytest.raises(BusError, match="the channel cannot be locked: No such file"):
        lock_channel(CAN0)


def test_serial_port_of_a_print_is_opened_by_no_second_program(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Its reader would lack the frames that the second one takes; a socket of a bus has each frame for everybody."""
    port = BusSettings("slcan", str(folder), 500_000)
    settings = {"slcan": port, "tcp": BusSettings("slcan", "socket://127.0.0.1:1"), "socketcan": CAN0}
    assert {name: one.has_one_reader for name, one in settings.items()} == dict.fromkeys(settings, False) | {
        "slcan": True
    }
    check_second_reader(port)
    monkeypatch.setattr("inkloop_hardware.doctor.status.holder", lambda settings: "process 7 since now")
    with pytest.raises(AnotherMaster, match=r"a print has the adapter \(process 7 since now\).*nothing was opened"):
        check_second_reader(port)
    check_second_reader(CAN0)
    *_, found, skipped = examine(port)
    assert (found.grade, skipped.grade) == (Grade.ERROR, Grade.SKIPPED)
    assert "a print has the adapter" in found.found


def test_lock_that_is_there_is_not_created_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Linux refuses that for a file of another user in the folder of everybody (protected_regular)."""
    lock_channel(CAN0)()
    opened = Mock(wraps=os.open)
    monkeypatch.setattr(os, "open", opened)
    lock_channel(CAN0)()
    assert not any(call.args[1] & os.O_CREAT for call in opened.call_args_list)


@pytest.mark.skipif(not hasattr(os, "O_NOFOLLOW"), reason="the system has no O_NOFOLLOW")
def test_link_that_lies_at_the_place_of_a_lock_is_not_followed(folder: Path) -> None:
    lock_channel(CAN0)()
    (lock,) = folder.iterdir()
    precious = folder / "precious"
    precious.write_text("mine")
    lock.unlink()
    lock.symlink_to(precious)
    with pytest.raises(BusError, match=r"the channel cannot be locked: .*; remove what is there"):
        lock_channel(CAN0)
    assert precious.read_text() == "mine"


def test_fmu_is_another_bench_for_each_print_and_needs_no_lock(folder: Path) -> None:
    lock_channel(BusSettings("inkloop_fmu", "bench.fmu"))()
    assert list(folder.iterdir()) == []


def test_lock_is_that_of_interface_channel_and_options_whatever_the_bit_rate(folder: Path) -> None:
    others = ({"interface": "kvaser"}, {"channel": "can1"}, {"options": {"app": 1}}, {"options": {"app": 2}})
    for one in (CAN0, *(replace(CAN0, **other) for other in others)):
        lock_channel(one)()
    count = len(list(folder.iterdir()))
    assert count == 1 + len(others)
    for same in ({"bitrate": 500_000}, {"fd": True, "data_bitrate": 2_000_000}, {"reopen_s": 1.0}):
        lock_channel(replace(CAN0, **same))()
    two = {"app": 1, "speed": 2}
    for options in (two, dict(reversed(two.items()))):
        lock_channel(replace(CAN0, options=options))()
    assert len(list(folder.iterdir())) == count + 1


def test_options_of_an_interface_are_handed_on_and_what_is_not_given_is_left_to_it() -> None:
    assert BusSettings("pcan", 3, options={"app": 1, "fd": False}).arguments() == {
        "interface": "pcan",
        "channel": 3,
        "app": 1,
        "fd": False,
    }
    given = BusSettings("pcan", "a", 500_000, fd=True, data_bitrate=2_000_000).arguments()
    assert (given["bitrate"], given["fd"], given["data_bitrate"]) == (500_000, True, 2_000_000)
    assert BusSettings().arguments() == {}


@pytest.mark.parametrize(("own", "expected"), [("virtual", "virtual"), ("slcam", "slcam"), ("", None)])
def test_interface_that_a_scenario_leaves_out_is_that_of_python_can_s_own_configuration(
    own: str, expected: str | None, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one that it does not know, for a message with its name."""
    monkeypatch.setenv("HOME", str(folder))
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    if own:
        monkeypatch.setenv("CAN_INTERFACE", own)
    assert interface_of(BusSettings()) == expected
    assert interface_of(BusSettings("pcan")) == "pcan"
    if expected is None:
        with pytest.raises(BusError, match=r"cannot be opened: it names none\. Set interface and channel of \[bench\]"):
            Adapter(BusSettings())
