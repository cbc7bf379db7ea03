"""BenchBus.fmu: Event Mode by the rules of FMI 3, operations by FMI-LS-BUS, parameters of the emulator."""

from __future__ import annotations

import ctypes
import struct
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fmpy import fmi3

from inkloop.cli import main
from inkloop.fmu.bus import BusFrame, operation, transmit
from inkloop.fmu.reading import describe
from inkloop.fmu_writer.archive import read_definition
from inkloop.fmu_writer.export import find_fmu
from support.benches import node_bench
from support.benches.bench_run import BLOCK, write
from support.fmus.bus_driver import ARE_YOU_THERE, MODEL, BusDriver
from support.fmus.fmu_checkers import by_fmpy
from support.fmus.fmu_driver import DISCARD, ERROR, OK

ALIVE, HEAD_STATUS, HEAD_ANSWER = b"\x02\x7e\x00", 0x101, 0x641


def in_step_mode(**parameters: object) -> BusDriver:
    return BusDriver().begin(**parameters)


def in_event_mode() -> BusDriver:
    """With nothing that waits."""
    fmu = in_step_mode()
    assert fmu.call("enterEventMode") == OK
    return fmu


def waiting() -> BusDriver:
    """In Step Mode, with an event that asks for Event Mode."""
    fmu = in_step_mode()
    assert fmu.fmu.doStep(0.0, 0.1)[0]
    return fmu


def ticking() -> BusDriver:
    """In Event Mode, with a clock that was set."""
    fmu = in_event_mode()
    assert fmu.tick() == OK
    return fmu


def set_faults(fmu: BusDriver, text: str) -> int:
    return fmu.call("setString", fmu.references["faults"], [text])


@pytest.mark.parametrize(
    ("mode", "call", "words"),
    [
        (BusDriver, lambda fmu: fmu.call("enterEventMode"), "not allowed in Instantiated"),
        (BusDriver, lambda fmu: fmu.tick(), "not allowed in Instantiated"),
        (in_step_mode, lambda fmu: fmu.tick(), "not allowed in Step Mode"),
        (in_step_mode, lambda fmu: fmu.call("enterStepMode"), "not allowed in Step Mode"),
        (in_step_mode, lambda fmu: fmu.call("updateDiscreteStates"), "not allowed in Step Mode"),
        (in_step_mode, lambda fmu: fmu.call("fmi3EvaluateDiscreteStates", fmu.fmu.component), "offers nothing"),
        (in_step_mode, lambda fmu: fmu.give(ARE_YOU_THERE), "set Rx_Clock first"),
        (in_step_mode, lambda fmu: set_faults(fmu, "loss"), "faults is a fixed parameter"),
        (waiting, lambda fmu: fmu.step(0.1), "an event waits"),
        (in_event_mode, lambda fmu: fmu.call("enterEventMode"), "not allowed in Event Mode"),
        (in_event_mode, lambda fmu: fmu.step(0.0), "not allowed in Event Mode"),
        (in_event_mode, lambda fmu: fmu.give(ARE_YOU_THERE), "set Rx_Clock first"),
        (in_event_mode, lambda fmu: fmu.tick("Tx_Clock"), "only input clocks"),
        (in_event_mode, lambda fmu: fmu.tick("nx"), "nx is of type unsigned integer, not clock"),
        (in_event_mode, lambda fmu: fmu.call("getBinary", fmu.references["faults"]), "faults is of type string"),
        (in_event_mode, lambda fmu: fmu.call("getClock", [10**6]), "no variable with value reference"),
        (ticking, lambda fmu: fmu.tick(value=False), "cannot be set back"),
        (ticking, lambda fmu: fmu.call("enterStepMode"), "a clock still ticks"),
        (ticking, lambda fmu: fmu.give(bytes(65537)), "Rx_Data has 65537 bytes; expected at most 65536"),
        (ticking, lambda fmu: fmu.give(b"x", "Tx_Data"), "while its clock does not tick|is calculated by the model"),
        (BusDriver, lambda fmu: set_faults(fmu, "x"), "no fault is called x"),
        (BusDriver, lambda fmu: set_faults(fmu, "unplugged"), "unplugged is a fault of an adapter"),
        (BusDriver, lambda fmu: set_faults(fmu, "malformed-line"), "malformed-line is a fault of an adapter"),
        (BusDriver, lambda fmu: set_faults(fmu, "loss; bus-off"), "bus-off is a fault of an adapter"),
        (BusDriver, lambda fmu: set_faults(fmu, "loss:" + "n" * 123), "faults: loss:nnn"),
        (
            in_step_mode,
            lambda fmu: fmu.step(0.0, 600.002),
            "the step has 600002 turns of 1 ms; expected at most 600000",
        ),
        (BusDriver, lambda fmu: set_faults(fmu, "loss;" * 201), "expected at most 1000"),
    ],
)
def test_calls_that_the_standard_does_not_allow_change_nothing(mode, call, words) -> None:
    with mode() as fmu:
        before = fmu.save()
        fmu.messages.clear()
        assert call(fmu) in (DISCARD, ERROR)
        assert any(word in fmu.messages[-1] for word in words.split("|")), fmu.messages
        assert fmu.save() == before


def test_event_mode_is_not_optional() -> None:
    with BusDriver() as driver:
        made = fmi3.FMU3Slave(guid=driver.fmu.guid, unzipDirectory=driver.fmu.unzipDirectory, modelIdentifier=MODEL)
        heard: list[str] = []
        with pytest.raises(Exception, match="Failed to instantiate"):
            made.instantiate(eventModeUsed=False, logMessage=lambda *given: heard.append(given[-1].decode()))
        assert "BenchBus has clocks and needs it" in heard[0]


def test_missing_arrays_are_errors_with_a_message() -> None:
    with in_event_mode() as fmu:
        instance, one = fmu.fmu.component, (ctypes.c_uint * 1)(fmu.references["Tx_Data"][0])
        for name, arguments in {
            "fmi3GetBinary": (instance, one, 1, None, None, 1),
            "fmi3SetBinary": (instance, one, 1, None, None, 1),
            "fmi3GetString": (instance, None, 1, None, 1),
            "fmi3GetClock": (instance, one, 1, None),
            "fmi3SetClock": (instance, None, 1, None),
            "fmi3UpdateDiscreteStates": (instance, *[None] * 6),
        }.items():
            fmu.messages.clear()
            assert fmu.call(name, *arguments) == ERROR, name
            assert fmu.messages[0].startswith(name)


def test_nodes_configure_the_bus_report_and_answer() -> None:
    with in_step_mode() as fmu:
        assert [found.content[8:] for _, found in fmu.sent] == [b"\x01" + struct.pack("<I", 500_000), b"\x04\x01"]
        for turn in range(1000):
            fmu.go(0.001, ARE_YOU_THERE if turn == 501 else b"")
        assert len(fmu.frames(HEAD_STATUS)) == 10
        (answer,) = fmu.frames(HEAD_ANSWER)
        assert answer.data[:3] == ALIVE
        (at,) = (at for at, found in fmu.sent if found.frame == answer)
        assert at == pytest.approx(0.502, abs=1e-9)
        assert (fmu.get("frames_received"), fmu.get("format_errors"), fmu.get("frames_lost")) == (1, 0, 0)
        assert fmu.get("frames_sent") == len(fmu.frames())


@pytest.mark.parametrize("sizes", [(0.0004, 0.0016), (0.007,), (0.1,), (0.25,)])
def test_frames_do_not_depend_on_the_steps(sizes) -> None:
    with in_step_mode() as fmu, in_step_mode() as other:
        for _ in range(1000):
            fmu.go(0.001)
        while other.now < 1.0 - 1e-9:
            for size in sizes:
                other.go(min(size, 1.0 - other.now))
        assert other.frames() == fmu.frames()


def test_turns_are_counted_from_the_start_time() -> None:
    with BusDriver() as fmu:
        fmu.start({}, start=1000.0)
        assert fmu.handle() == OK
        fmu.go(1.0)
        assert len(fmu.frames(HEAD_STATUS)) == 10


def test_text_of_faults_is_taken_up_to_its_length_and_kept_where_the_grid_changes() -> None:
    """Earlier settings leave nothing behind."""
    with BusDriver() as fmu, BusDriver() as other:
        assert set_faults(fmu, ";" * 996 + "loss") == OK
        assert max(set_faults(fmu, "loss"), set_faults(other, "loss")) == OK
        assert fmu.save() == other.save()
        assert fmu.resize(8, 7) == OK
        assert fmu.fmu.getString(fmu.references["faults"]) == ["loss"]
        assert fmu.resize(65536, 1) != OK
        assert "65536 x 1 cells: the nodes hold at most 65535 cells along an axis" in fmu.messages[-1]


def test_empty_binary_is_taken_while_its_clock_does_not_tick() -> None:
    with in_step_mode() as fmu:
        assert fmu.give(b"") == OK


def test_node_that_is_off_the_bus_is_a_fault_that_the_fmu_has() -> None:
    with BusDriver() as fmu:
        assert set_faults(fmu, "bus-off:node=head") == OK


def test_start_surface_is_shown_before_the_first_step_and_stays_until_droplets_come() -> None:
    with in_step_mode(height_start=4e-6) as fmu:
        assert (fmu.get("surface_height") == 4e-6).all()
        fmu.go(0.5)
        assert (fmu.get("surface_height") == 4e-6).all()


@pytest.mark.parametrize(
    ("given", "answers"),
    [
        (operation(0x20, bytes(4)) + operation(0x40, b"\1" + bytes(4)), 0),
        (operation(0x41, b"\1") + operation(0x42, b"") + operation(0x31, bytes(7)), 0),
        (operation(0x11, bytes(20)), 1),  # CAN FD
        (operation(0x99, b"?"), 1),
        (operation(0x20, bytes(3)), 1),
        (operation(0x30, bytes(5)), 1),
        (operation(0x31, bytes(8)), 1),
        (operation(0x40, b""), 1),
        (operation(0x41, b""), 1),
        (operation(0x41, bytes(2)), 1),
        (operation(0x42, b"?"), 1),
        (operation(0x10, struct.pack("<IBBH", 0x640, 0, 0, 9) + bytes(9)), 1),
        (operation(0x10, struct.pack("<IBBH", 0x640, 2, 0, 0)), 1),
        (operation(0x10, struct.pack("<IBBH", 0x640, 0, 2, 0)), 1),
        (operation(0x10, struct.pack("<IBBH", 2**29, 1, 0, 0)), 1),
        (operation(0x10, struct.pack("<IBBH", 2**29 - 1, 1, 0, 0)), 0),
        (operation(0x10, struct.pack("<IBBH", 0x800, 0, 0, 0)), 1),
        (operation(0x10, struct.pack("<IBBH", 0x640, 0, 0, 8) + bytes(7)), 1),
        (operation(0x99, b"?") + ARE_YOU_THERE + b"\x10\0\0", 2),
        (struct.pack("<II", 0x10, 2**32 - 1) + bytes(16), 1),
        (struct.pack("<II", 0x10, 0), 1),
    ],
)
def test_operations_that_cannot_be_read_are_answered_with_format_error(given, answers) -> None:
    with in_step_mode() as fmu:
        fmu.sent.clear()
        fmu.go(0.001, given)
        wrong = [found.content for _, found in fmu.sent if found.code == 0x01]
        assert len(wrong) == answers == fmu.get("format_errors")
        for content in wrong:
            length, quoted = struct.unpack_from("<H", content, 8)[0], content[10:]
            assert len(quoted) == length
            assert quoted
            assert quoted in given
        assert bool(fmu.frames(HEAD_ANSWER)) == (ARE_YOU_THERE in given)


def test_frames_that_the_bus_loses_are_counted() -> None:
    """And what a partner could not read."""
    with in_step_mode() as fmu:
        fmu.go(0.001, operation(0x30, bytes(4)) + operation(0x31, bytes(6) + b"\1") + operation(0x01, bytes(2)))
        assert (fmu.get("frames_lost"), fmu.get("format_errors")) == (2, 1)


def test_run_replays_from_a_state_of_either_mode_bit_by_bit() -> None:
    with in_step_mode(variation=0.3) as fmu, in_step_mode(printer_seed=5) as other:
        fmu.go(0.3, ARE_YOU_THERE)
        for enter in (False, True):
            if enter:
                assert max(fmu.call("enterEventMode"), fmu.tick(), fmu.give(ARE_YOU_THERE)) == OK
            saved, at = fmu.save(), fmu.now
            ends = []
            for each in (fmu, other):
                assert each.restore(saved) == OK
                assert each.save() == saved
                each.sent.clear()
                each.now = at
                if enter:
                    assert each.handle() == OK
                each.go(0.25, ARE_YOU_THERE)
                ends.append((each.save(), each.sent))
            assert ends[0] == ends[1]
            assert ends[0][0] != saved


@pytest.mark.compiled
def test_parameters_are_those_of_the_fmus_and_of_the_emulator() -> None:
    """Their enumeration too; the resolution has another start value. Values and defaults of the emulator."""
    model, c = read_definition(find_fmu(MODEL)), node_bench.library()
    printer, sensor = (read_definition(find_fmu(name)) for name in ("LayerDeposition", "ProfileSensor"))
    taken = set(model.emulated)
    assert {v.name for v in {*printer.emulated, *sensor.emulated} - taken} == {"resolution"}
    assert taken < {*printer.emulated, *sensor.emulated}
    assert model.types.items() <= printer.types.items()
    scalars = [v for v in model.variables if v.causality in ("parameter", "structural") and not v.is_grid]
    options = c.probe_options()
    before = ctypes.string_at(options, c.probe_options_size())
    for variable in scalars:
        if variable.type != "string":
            assert c.bench_set(options, variable.name.encode(), float(variable.start)), variable.name
            assert ctypes.string_at(options, len(before)) == before, variable.name


@pytest.mark.parametrize("form", ["fmi3", "fmi3-fixed"])
def test_archive_names_its_bus_as_the_layered_standard_does(form) -> None:
    path = find_fmu(MODEL, form)
    assert by_fmpy(path) == []
    with zipfile.ZipFile(path) as archive:
        terminals = ElementTree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        manifest = ElementTree.fromstring(archive.read("extra/org.fmi-standard.fmi-ls-bus/fmi-ls-manifest.xml"))
    (bus,) = (found for found in terminals.iter("Terminal") if found.get("name") == "bench")
    assert bus.get("terminalKind") == "org.fmi-ls-bus.network-terminal"
    assert bus.get("matchingRule") == "org.fmi-ls-bus.transceiver"
    members = {m.get("memberName"): m.get("variableKind") for m in bus}
    assert members == dict.fromkeys(("Rx_Data", "Rx_Clock", "Tx_Data", "Tx_Clock"), "signal")
    space = "{http://fmi-standard.org/fmi-ls-manifest}"
    assert manifest.get(f"{space}fmi-ls-name") == "org.fmi-standard.fmi-ls-bus"
    assert manifest.get("isBusSimulationFMU") == "false"
    (served,) = describe(path).buses
    assert served.name == "bench"


def test_exported_bench_is_that_of_its_scenario(tmp_path: Path) -> None:
    """Grid, parameters and faults are its start values, in the description and in the binary; other files are
    refused.
    """
    lost = '\n[[bench.faults]]\nkind = "loss"\nprobability = 1.0\nid = 0x641\n'
    files = [tmp_path / "plain.fmu", tmp_path / "lossy.fmu"]
    for file, text in zip(files, (BLOCK, BLOCK + lost), strict=True):
        assert main(["export", "bench", str(write(tmp_path, text)), "--out", str(file), "--quiet"]) == 0
    folders = [fmu_folder(file) for file in files]
    for folder, is_lossy in zip(folders, (False, True), strict=True):
        with BusDriver("fmi3-fixed", 12, 11, folder).begin() as fmu:
            assert (fmu.get("variation"), fmu.get("watchdog_ms"), fmu.get("nx")) == (0.2, 1000, 12)
            fmu.go(0.01, ARE_YOU_THERE)
            fmu.go(0.01)
            assert bool(fmu.frames(HEAD_ANSWER)) == (not is_lossy)
        described = {v.name: v for v in describe(files[0]).variables.values()}
        assert described["variation"].start == ("0.2",)
    (folders[0] / "resources" / "bench.bin").write_bytes((folders[1] / "resources" / "bench.bin").read_bytes())
    with pytest.raises(Exception, match="Failed to instantiate"):
        BusDriver("fmi3-fixed", 12, 11, folders[0])


def fmu_folder(file: Path) -> Path:
    folder = file.with_suffix("")
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder)
    return folder


def test_fault_of_the_bus_hits_its_frames() -> None:
    with BusDriver() as fmu:
        assert set_faults(fmu, "duplication:id=0x641; loss:id=0x101,nth=1,count=3") == OK
        fmu.begin()
        for turn in range(600):
            fmu.go(0.001, ARE_YOU_THERE if turn == 5 else b"")
        assert len(fmu.frames(HEAD_ANSWER)) == 2
        assert len(fmu.frames(HEAD_STATUS)) == 3
        assert len(fmu.frames(0x102)) == 6


def test_step_that_sends_more_than_its_binary_holds_loses_frames_and_says_so() -> None:
    with in_step_mode() as fmu:
        fmu.go(100.0)
        assert fmu.get("frames_lost") > 0
        assert fmu.get("frames_sent") == len(fmu.frames())


def test_extended_frame_is_no_request() -> None:
    with in_step_mode() as fmu:
        frame = BusFrame(0x640, bytes.fromhex("023e00cccccccccc"), is_extended=True)
        fmu.go(0.01, transmit(frame))
        fmu.go(0.01)
        assert not fmu.frames(HEAD_ANSWER)
        assert fmu.get("frames_received") == 1
