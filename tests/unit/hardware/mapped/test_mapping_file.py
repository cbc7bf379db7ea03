"""A mapping file is valid, or all its errors are reported with their places; patterns and maps follow its tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inkloop.component import Job
from inkloop.components import catalog
from inkloop.errors import ScenarioError
from inkloop.testing import job as small_job
from inkloop_hardware.errors import TransferError
from inkloop_hardware.mapped.mapped_bytes import hexadecimal, map_size, number, pattern_bytes, read_map
from inkloop_hardware.mapped.mapping_file import factor, load
from inkloop_hardware.mapped.mapping_tables import CELLS, MapTable, PatternTable, Read, RoutineStep, Upload
from inkloop_hardware.protocol.codec import EXTENDED
from support.benches import foreign_rig

JOB = small_job(6, 5)
FIELDS = {"job": 0xC0FFEE, "layer": 7, "nx": 6, "ny": 5}


def written(folder: Path, *changes: tuple[str, str], more: str = "") -> Path:
    text = foreign_rig.MAPPING
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "rig.dbc").write_text(foreign_rig.DBC)
    (folder / "rig.toml").write_text(text + more)
    return folder / "rig.toml"


def errors(folder: Path, *changes: tuple[str, str], more: str = "") -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as refused:
        load(written(folder, *changes, more=more), JOB)
    return refused.value.errors


def test_names_of_messages_become_the_ids_of_peers(tmp_path: Path) -> None:
    assert load(written(tmp_path), JOB).ids == {"head": (0x7A0, 0x7A8), "scanner": (0x7B0, 0x7B8)}
    long = written(tmp_path, ("0x7B0", "0x18DA10F1"), ("0x7B8", "0x18DAF110"))
    assert load(long, JOB).ids["scanner"] == (EXTENDED | 0x18DA10F1, EXTENDED | 0x18DAF110)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'message = "PlcCommand"',
            'message = "PlcComand"',
            "printer step 2 (send): message is 'PlcComand'; did you mean",
        ),
        ('signal = "State"', 'signal = "Stat"', "printer step 3 (wait): signal is 'Stat'; did you mean State?"),
        ('expected = "BUSY"', 'expected = "BUZY"', "printer step 3 (wait): expected is 'BUZY'; did you mean BUSY?"),
        ('unless = "FAULT"', 'unless = "FALT"', "printer step 3 (wait): unless is 'FALT'; did you mean FAULT?"),
        ('Go = "GO"', 'Go = "RUN"', "printer step 2 (send): message PlcCommand: Go is 'RUN', expected one of HOLD, GO"),
        (
            "Lamp = 37.5",
            "Lamp = 137.5",
            "printer step 2 (send): message PlcCommand: Lamp is 137.5 %, expected 0 to 100",
        ),
        (", Lamp = 37.5", "", "printer step 2 (send): message PlcCommand lacks a value for 'Lamp'"),
        ('LayerNo = "{layer}"', 'LayerNo = "{lyer}"', "printer step 2 (send): '{lyer}'; expected a number or a templ"),
        ('peer = "scanner"', 'peer = "scaner"', "profiler step 1 (routine): peer is 'scaner'; did you mean scanner?"),
        (
            "request = 0x7B0",
            "request = 0x17B0",
            "peers.scanner: 0x000017B0 and 0x7B8; expected two 11-bit or 29-bit ids",
        ),
        ("request = 0x7B0", "request = 0x20000000", "peers.scanner.request is 0x20000000; expected an id of 11 or"),
        ('request = "HeadRequest"', 'request = "HeadAsk"', "peers.head.request: message is 'HeadAsk'; did you mean"),
        ('unit = "um"', 'unit = "inch"', "map.unit is 'inch'; expected one of nm, um"),
        ('unit = "m"', 'unit = "s"', "outputs.bed_position: unit is 's', to which the [mm] of BedPosition does not"),
        ("A5 {layer:04x}", "A5 {layer.x}", "pattern.header is 'A5 {layer.x}'; expected pairs"),
        (
            "A5 {layer:04x}",
            "A5 {layer:03x}",
            "pattern.header is 'A5 {layer:03x}'; expected pairs of hexadecimal digits",
        ),
        (
            "A5 {layer:04x}",
            "A5 {layer:0999999999x}",
            "pattern.header is 'A5 {layer:0999999999x}'; expected pairs of he",
        ),
        ('answer = "01"', 'answer = "0{x}"', "profiler step 1 (routine): answer is '0{x}'; expected pairs"),
        ("[map]", "[mapp]", "mapp is not a key of this table"),
        ("bits = 2", "bits = 3", "pattern.bits is 3; expected 1, 2, 4 or 8"),
        ('do = "send"', 'do = "sent"', "printer.2.do is 'sent'; did you mean send?"),
        (
            "limit_s = 10.0",
            'limit_s = 10.0\nenables = ["lamp"]',
            "printer step 3 (wait): enables are of the heartbeat; wr",
        ),
        ('dbc = "rig.dbc"', 'dbc = "none.dbc"', "dbc: "),
        ("[peers.head]", "[peers.head", "is not TOML"),
        ('address = "{layer}"', 'address = "{layer:999999999d}"', "printer step 1 (download): address is '{layer:999"),
        ('address = "{layer}"', 'address = "{layer:{nx}d}"', "printer step 1 (download): address is '{layer:{nx}d}'"),
        ('address = "{layer}"', "address = -1", "printer step 1 (download): address is 0x-1; expected 0 to 0xFF"),
        (
            "address = 0x20",
            "address = 0x100",
            "profiler step 3 (upload): address is 0x100; expected 0 to 0xFF by addres",
        ),
        (
            'expected = "{layer}"\nlimit_s = 10.0\n\n[[profiler]]\ndo = "upload"',
            'expected = "{lyer}"\nlimit_s = 10.0\n\n[[profiler]]\ndo = "upload"',
            "profiler step 2 (read): expected is '{lyer}'; expected a number or a template of one",
        ),
        ('option = "{layer:04x}"', 'option = "{layer:03x}"', "profiler step 1 (routine): option is '{layer:03x}'; exp"),
        (
            "484D {nx:02x}",
            "484D {nx:03x}",
            "map.header is '484D {nx:03x}{ny:02x}'; expected pairs of hexadecimal digits",
        ),
        (
            'do = "read"\npeer = "scanner"',
            'do = "read"\npeer = "head1"',
            "profiler step 2 (read): peer is 'head1'; did you",
        ),
        (
            "[[profiler]]                 # the steps of a scan\ndo",
            '[[start]]\ndo = "download"\npeer = "head"\n[[profiler]]\ndo',
            "a download is a step of the printer, an upload one of the profiler; move it there",
        ),
        (
            "[[profiler]]                 # the steps of a scan\ndo",
            '[[stop]]\ndo = "upload"\npeer = "head"\n[[profiler]]\ndo',
            "a download is a step of the printer, an upload one of the profiler; move it there",
        ),
        (
            "[[profiler]]                 # the steps of a scan\ndo",
            '[[printer]]\ndo = "upload"\npeer = "head"\n[[profiler]]\ndo',
            "a download is a step of the printer, an upload one of the profiler; move it there",
        ),
        (
            "[[profiler]]                 # the steps of a scan\ndo",
            '[[profiler]]\ndo = "download"\npeer = "head"\n[[profiler]]\ndo',
            "a download is a step of the printer, an upload one of the profiler; move it there",
        ),
        (
            "[[profiler]]                 # the steps of a scan\ndo",
            '[[profiler]]\ndo = "upload"\npeer = "head"\n[[profiler]]\ndo',
            'profiler has 2 steps do = "upload"; measured_height needs exactly one',
        ),
    ],
)
def test_error_is_reported_with_its_place(old: str, new: str, message: str, tmp_path: Path) -> None:
    found = errors(tmp_path, (old, new))
    assert any(error.startswith(message) for error in found), found


def test_can_fd_is_needed_where_a_message_or_a_peer_has_it(tmp_path: Path) -> None:
    assert not load(written(tmp_path), JOB).needs_fd
    assert load(written(tmp_path, ('message = "PlcState"', 'message = "WideState"')), JOB).needs_fd
    assert load(written(tmp_path, ("answer = 0x7B8", "answer = 0x7B8\nfd = true")), JOB).needs_fd


def test_ids_beyond_0x7ff_have_29_bits(tmp_path: Path) -> None:
    last = written(tmp_path, ("0x7B0", "0x7FE"), ("0x7B8", "0x7FF"))
    assert load(last, JOB).ids["scanner"] == (0x7FE, 0x7FF)
    first = written(tmp_path, ("0x7B0", "0x800"), ("0x7B8", "0x1FFFFFFF"))
    assert load(first, JOB).ids["scanner"] == (EXTENDED | 0x800, EXTENDED | 0x1FFFFFFF)


def test_address_has_as_many_bytes_as_are_said(tmp_path: Path) -> None:
    path = written(tmp_path, ("address = 0x20", "address = 0xFF"), ('address = "{layer}"', "address = 0xFFFFFFFF"))
    assert load(path, JOB).tables.profiler[2].address == 0xFF
    assert errors(tmp_path, ('address = "{layer}"', "address = 0x100000000")) == (
        "printer step 1 (download): address is 0x100000000; expected 0 to 0xFFFFFFFF by address_bytes",
    )


def test_supervised_message_is_sent_without_its_check_byte(tmp_path: Path) -> None:
    path = written(tmp_path, ('LayerNo = "{layer}", Go = "GO", Lamp = 37.5', 'LayerNo = "{layer}"'))
    command = foreign_rig.DBC[foreign_rig.DBC.index("BO_ 528") : foreign_rig.DBC.index("BO_ 544")]
    supervised = """BO_ 528 PlcCommand: 4 Pc
 SG_ Crc8 : 0|8@1+ (1,0) [0|255] "" Plc
 SG_ Counter : 8|4@1+ (1,0) [0|14] "" Plc
 SG_ LayerNo : 16|16@1+ (1,0) [0|65535] "" Plc
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_DEF_ "E2EDataId" 0;
BA_ "E2EDataId" BO_ 528 5;
"""
    text = foreign_rig.DBC.replace(command, supervised[: supervised.index("BA_DEF_ ")])
    text = text.replace('VAL_ 528 Go 0 "HOLD" 1 "GO" ;\n', supervised[supervised.index("BA_DEF_ ") :])
    (tmp_path / "rig.dbc").write_text(text)
    assert load(path, JOB).codec.data_id("PlcCommand") == 5


def test_messages_beside_overlapping_signals_are_mapped_if_that_is_meant(tmp_path: Path) -> None:
    path = written(tmp_path)
    odd = 'BO_ 100 Odd: 2 Plc\n SG_ One : 0|8@1+ (1,0) [0|255] "" Pc\n SG_ Two : 4|8@1+ (1,0) [0|255] "" Pc\n'
    (tmp_path / "rig.dbc").write_text(foreign_rig.DBC.replace("BO_ 528", f"{odd}BO_ 528", 1))
    with pytest.raises(ScenarioError, match="strict = false reads the messages without overlapping signals"):
        load(path, JOB)
    path.write_text(path.read_text().replace('dbc = "rig.dbc"', 'dbc = "rig.dbc"\nstrict = false'))
    assert load(path, JOB).ids["scanner"] == (0x7B0, 0x7B8)


def test_missing_dbc_is_reported_beside_the_errors_of_keys(tmp_path: Path) -> None:
    found = errors(tmp_path, ("bits = 2", "bits = 3"), ('dbc = "rig.dbc"', 'dbc = "none.dbc"'))
    assert found == ("pattern.bits is 3; expected 1, 2, 4 or 8", f"dbc: {tmp_path / 'none.dbc'} is not there")


@pytest.mark.parametrize(
    ("source", "target", "expected"),
    [
        ("mm", "m", 1e-3),
        ("m", "um", 1e6),
        ("µm", "um", 1.0),
        ("ms", "s", 1e-3),
        ("s", "ms", 1e3),
        ("V", "V", 1.0),
        ("mm", "s", None),
        ("V", "mV", None),
    ],
)
def test_unit_converts_to_one_of_its_quantity(source: str, target: str, expected: float | None) -> None:
    assert factor(source, target) == (None if expected is None else pytest.approx(expected, rel=1e-12, abs=0.0))


def test_signal_that_is_waited_for_is_named_by_its_first_place(tmp_path: Path) -> None:
    again = '\n[[stop]]\ndo = "wait"\nmessage = "PlcState"\nsignal = "State"\nexpected = "IDLE"\n\n[outputs'
    tables = load(written(tmp_path, ("\n[outputs", again)), JOB).tables
    places = {"State": "printer step 3", "LayersDone": "printer step 4", "BedPosition": "outputs.bed_position"}
    assert tables.awaited == {"PlcState": places}


def test_what_a_mapping_leaves_out_is_as_the_page_says() -> None:
    pattern, heights = PatternTable(), MapTable(unit="um")
    assert (pattern.header, pattern.bits, pattern.bit_order, pattern.fastest, pattern.whole_lines) == (
        *("", 1, "msb", "y"),
        False,
    )
    assert (heights.cell, heights.byte_order, heights.scale, heights.datum, heights.fastest) == (
        *("int16", "big"),
        *(1.0, 0.0, "y"),
    )
    assert (heights.invalid, heights.valid_bits) == (None, False)
    step = RoutineStep(do="routine", peer="head", routine=1)
    assert (step.limit_s, step.enables, step.acts, step.option, step.answer) == (60.0, (), True, "", "")
    read = Read(do="read", peer="head", identifier=1, expected=1)
    assert (read.at, read.bytes) == (0, 1)
    place = Upload(do="upload", peer="head")
    assert (place.address, place.address_bytes, place.size_bytes, place.check) == (0, 4, 4, "none")


def test_message_of_a_length_that_no_frame_has_is_an_error(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "rig.dbc").write_text(foreign_rig.DBC.replace("PlcState: 8", "PlcState: 10"))
    with pytest.raises(ScenarioError, match="PlcState has 10 bytes; a frame has up to 8, 12, 16, 20, 24, 32, 48 or 64"):
        load(path, JOB)


def test_port_that_nothing_feeds_is_reported(tmp_path: Path) -> None:
    sections = foreign_rig.MAPPING.split("\n[[")
    without = {
        "download": 'printer has no step do = "download": the input pattern goes nowhere; add one',
        "upload": 'profiler has 0 steps do = "upload"; measured_height needs exactly one',
    }
    for step, message in without.items():
        kept = "\n[[".join(part for part in sections if f'do = "{step}"' not in part.split("[outputs")[0])
        (tmp_path / "rig.dbc").write_text(foreign_rig.DBC)
        (tmp_path / "rig.toml").write_text(kept)
        with pytest.raises(ScenarioError) as refused:
            load(tmp_path / "rig.toml", JOB)
        assert refused.value.errors == (message,)
    (tmp_path / "rig.toml").write_text('dbc = "rig.dbc"\n')
    with pytest.raises(ScenarioError, match="binds no port; add"):
        load(tmp_path / "rig.toml", JOB)


def test_all_errors_are_reported_at_once(tmp_path: Path) -> None:
    """Also those of tables that steps need and that are not there."""
    found = errors(tmp_path, ('signal = "State"', 'signal = "Stat"'), ('peer = "scanner"', 'peer = "scaner"'))
    assert [error.split(":")[0] for error in found] == ["printer step 3 (wait)", "profiler step 1 (routine)"]
    text = foreign_rig.MAPPING
    (tmp_path / "rig.toml").write_text(text[: text.index("[pattern]")] + text[text.index("[[printer]]") :])
    with pytest.raises(ScenarioError) as refused:
        load(tmp_path / "rig.toml", JOB)
    assert [error.split(";")[0] for error in refused.value.errors] == ["pattern is missing", "map is missing"]


def test_scenario_names_the_errors_of_its_mapping(tmp_path: Path) -> None:
    path = written(tmp_path, ('unit = "um"', 'unit = "inch"'))
    (error,) = catalog.check("hardware.mapped", JOB, {"mapping": str(path)}).errors
    assert error.startswith("mapping: rig.toml: map.unit is 'inch'")
    (error,) = catalog.check("hardware.mapped", JOB, {"mapping": str(tmp_path / "none.toml")}).errors
    assert error.startswith("mapping: none.toml: cannot be read")
    assert not catalog.check("hardware.mapped", JOB, {"mapping": str(written(tmp_path))}).errors


def ports(folder: Path, job: Job, keep: str) -> tuple[set[str], set[str]]:
    """Inputs and outputs of a rig with the steps of one section only."""
    sections = foreign_rig.MAPPING.split("\n[[")
    drop = {"printer": "profiler]]", "profiler": "printer]]"}[keep]
    text = "\n[[".join(part.split("\n[outputs")[0] for part in sections if not part.startswith(drop))
    (folder / "rig.dbc").write_text(foreign_rig.DBC)
    (folder / "rig.toml").write_text(text + foreign_rig.MAPPING[foreign_rig.MAPPING.index("[outputs") :])
    part = catalog.make("hardware.mapped", job, {"mapping": str(folder / "rig.toml")})
    return {port.name for port in part.inputs}, {port.name for port in part.outputs}


def test_rig_has_the_ports_that_it_has_steps_for(tmp_path: Path) -> None:
    inputs, outputs = ports(tmp_path, JOB, "printer")
    assert inputs == {"pattern", "layer_command"}
    assert outputs == {"layers_printed", "layer_unknown", "status", "bed_position"}
    inputs, outputs = ports(tmp_path, JOB, "profiler")
    assert inputs == {"layers_printed"}
    assert outputs == {"measured_height", "valid", "layers_scanned", "status", "bed_position"}


def test_templates_are_filled_in() -> None:
    assert hexadecimal("A5 {layer:04x} {job:08x}", FIELDS) == bytes.fromhex("a5000700c0ffee")
    assert number("0x{layer}0", FIELDS) == 0x70
    assert number(3, FIELDS) == 3


def test_cells_lie_as_the_table_specifies() -> None:
    pattern = np.zeros((3, 2), np.int32)
    pattern[2, 0], pattern[0, 1] = 1, 2
    fields = {**FIELDS, "nx": 3, "ny": 2}
    found = {
        (order, fastest, whole): pattern_bytes(
            pattern, PatternTable(bits=2, bit_order=order, fastest=fastest, whole_lines=whole), fields
        ).hex()
        for order in ("msb", "lsb")
        for fastest in ("x", "y")
        for whole in (False, True)
    }
    assert found == {
        ("msb", "y", False): "2040",  # 0 2 | 0 0 | 1 0
        ("msb", "y", True): "200040",
        ("msb", "x", False): "0600",  # 0 0 1 | 2 0 0
        ("msb", "x", True): "0480",
        ("lsb", "y", False): "0801",
        ("lsb", "y", True): "080001",
        ("lsb", "x", False): "9000",
        ("lsb", "x", True): "1002",
    }


def test_material_that_the_bits_do_not_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="the pattern has material 2, too much for 1 bit per cell; set bits = 2"):
        pattern_bytes(np.full((6, 5), 2), PatternTable(), FIELDS)
    for bits, highest in ((1, 1), (2, 3)):
        pattern_bytes(np.full((6, 5), highest), PatternTable(bits=bits), FIELDS)  # type: ignore[arg-type]
        for material in (-1, highest + 1):
            with pytest.raises(ValueError, match=f"{bits} bit per cell"):
                pattern_bytes(np.full((6, 5), material), PatternTable(bits=bits), FIELDS)  # type: ignore[arg-type]


@given(
    cell=st.sampled_from(sorted(CELLS)),
    order=st.sampled_from(["big", "little"]),
    fastest=st.sampled_from(["x", "y"]),
    marks=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_map_is_read_back_as_it_was_laid_out(cell: Any, order: Any, fastest: Any, marks: bool, seed: int) -> None:
    form: dict[str, Any] = {"byte_order": order, "fastest": fastest, "header": "01 {nx:02x}"}
    table = MapTable(cell=cell, valid_bits=marks, unit="um", scale=0.1, datum=2.0, invalid=255, **form)
    random = np.random.default_rng(seed)
    readings, seen = random.integers(0, 255, (6, 5)), random.random((6, 5)) < 0.8
    laid = np.where(seen, readings, 255) if not marks else readings
    lines = laid if fastest == "y" else laid.T
    data = b"\x01\x06" + lines.astype((">" if order == "big" else "<") + CELLS[cell]).tobytes()
    if marks:
        data += np.packbits(seen if fastest == "y" else seen.T.reshape(-1)).tobytes()
    assert len(data) == map_size(table, FIELDS)
    height, valid = read_map(data, table, FIELDS)
    np.testing.assert_array_equal(valid, seen)
    np.testing.assert_allclose(height, np.where(seen, (readings * 0.1 + 2.0) * 1e-6, 0.0), atol=1e-15)


def test_cells_that_are_no_number_are_not_valid_and_a_map_of_another_form_is_refused() -> None:
    for value in (np.nan, np.inf, -np.inf):
        height, valid = read_map(np.full(30, value, ">f4").tobytes(), MapTable(cell="float32", unit="mm"), FIELDS)
        assert not valid.any()
        assert not height.any()
    whole = {**FIELDS, "nx": 4, "ny": 2}
    assert map_size(MapTable(unit="um", valid_bits=True), whole) == 8 * 2 + 1, "eight cells are one byte of marks"
    for data, message in (
        (b"\x02" + bytes(60), "the map begins with 02, expected 01"),
        (b"\x01", "the map has 1 bytes, expected 61"),
        (b"\x01" + bytes(61), "the map has 62 bytes, expected 61"),
    ):
        with pytest.raises(TransferError, match=message):
            read_map(data, MapTable(header="01", unit="um"), FIELDS)
