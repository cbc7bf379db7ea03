"""FMI calls in any order with any arguments: each does what the standard requires, or is refused with a message and
changes nothing, bit by bit; nothing crashes or hangs.

The invariants around every call are in tests/fuzz/fmus/subject.c. Here they hold for inputs drawn once, on the FMUs
as they are shipped, each in a separate process; with clang, libFuzzer looks for others. What was found has its own test
below.
"""

from __future__ import annotations

import ctypes
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from fmpy import fmi2, fmi3

from support.examples import examples
from support.fmus import fmu_library, fuzzing
from support.fmus.fmu_driver import DEPOSITION_MODELS, DISCARD, ERROR, EVERY_FORM, OK, Driver
from support.fmus.fmu_library import DRAWN, NAMES, drawn, feed
from support.fmus.fmu_life import EVERY_MODEL, started
from support.long_proofs import rest_is_long

RESIZABLE = [name for name in NAMES if name.endswith("fmi3") and fmu_library.JOB not in name]
CALLED = [*((name, name in RESIZABLE) for name in NAMES), *((name, False) for name in RESIZABLE)]
CALLED = rest_is_long(CALLED, len(NAMES))
"""FMUs, and whether with their structural parameters where they have any."""

needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def calls(folder: Path) -> Path:
    return fmu_library.calls_program(folder)


@pytest.mark.compiled
@needs_gcc
@pytest.mark.parametrize(("name", "resizable"), CALLED)
def test_calls_follow_the_standard_or_change_nothing(name, resizable, calls, folder) -> None:
    """And many of them print layers and are refused, so that the inputs mean something."""
    model, form = name.split("-")
    table = folder / f"{name}-{resizable}.txt"
    fmu_library.write_table(fmu_library.shipped(model, form, folder), table, resizable=resizable)
    inputs = drawn(name, examples(DRAWN))
    counts = re.findall(r"^steps (\d+) layers (\d+) refusals (\d+)$", feed(calls, table, inputs), re.MULTILINE)
    steps, layers, refusals = np.array(counts, int).sum(axis=0)
    assert len(counts) == len(inputs)
    assert min(steps, layers) > 2 * len(inputs)
    assert refusals > 10 * len(inputs)


@pytest.mark.compiled
@needs_gcc
@pytest.mark.parametrize(
    ("change", "broken"),
    [
        (lambda text: text.replace("variation r p", "variation r -"), "does not allow does not succeed"),
        (lambda text: re.sub(r"(variation r p .*) 1.0 inf", r"\1 0.0001 inf", text), "beyond its limits is not taken"),
        (lambda text: text.replace("-resizable", ""), "is legal and sensible succeeds"),
    ],
)
def test_checks_detect_broken_invariants(change, broken, calls, folder) -> None:
    """With a wrong table of the FMU, they report what does not hold."""
    table = fmu_library.write_table(fmu_library.shipped("LayerDeposition", "fmi3", folder), folder / "wrong.txt")
    text = table.read_text()
    assert change(text) != text
    table.write_text(change(text))
    with pytest.raises(AssertionError, match=broken):
        feed(calls, table, drawn("LayerDeposition-fmi3"))


@pytest.mark.compiled
@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_fuzzer_finds_nothing_in_minutes(name, folder) -> None:
    """libFuzzer on a build with sanitizers, another way each time."""
    compiler = fuzzing.clang()
    if compiler is None:
        pytest.skip("clang with libFuzzer is not installed; make tools")
    program, tables = fmu_library.fuzzers([name], folder, compiler)
    assert not fuzzing.fuzz(name, program, 20, folder / "learned" / name, table=tables[name])


# Cases found by the invariants, by sanitizers or by reading.


@EVERY_FORM
@EVERY_MODEL
def test_reading_changes_nothing_that_is_saved(model, form) -> None:
    """Outputs before the first step are calculated when they are first read; a state is the same before and after."""
    with Driver(model, form) as fmu:
        before = fmu.save()
        fmu.outputs()
        assert fmu.save() == before


@pytest.mark.parametrize("model", DEPOSITION_MODELS)
def test_outputs_in_configuration_mode_are_of_the_grid_that_is_still_there(model) -> None:
    """They were calculated for the grid to come, in the memory of the present one."""
    with Driver(model) as fmu:
        assert fmu.set("height_start", 2e-6) == OK
        assert fmu.call("enterConfigurationMode") == OK
        assert fmu.call("setUInt64", fmu.references["nx"], [1]) == OK
        assert (fmu.get("height") == 2e-6).all()
        assert fmu.get("height_mean") == pytest.approx(2e-6, rel=1e-9, abs=0.0)


@EVERY_FORM
@EVERY_MODEL
def test_missing_arguments_are_errors_with_a_message(model, form) -> None:
    with started(model, form) as fmu:
        instance, before = fmu.fmu.component, fmu.save()
        one = (ctypes.c_uint * 1)(fmu.references["seed"][0])
        integer = ctypes.c_int()
        if fmu.is_fmi2:
            wrong = {
                "fmi2GetInteger": (instance, None, 1, ctypes.byref(integer)),
                "fmi2SetInteger": (instance, one, 1, None),
                "fmi2GetFMUstate": (instance, None),
                "fmi2SetFMUstate": (instance, None),
                "fmi2SetDebugLogging": (instance, True, 1, None),
                "fmi2SerializedFMUstateSize": (instance, None, None),
                "fmi2SerializeFMUstate": (instance, None, (ctypes.c_char * 1)(), 1),
                "fmi2DeSerializeFMUstate": (instance, (ctypes.c_char * 1)(), 1, None),
                "fmi2GetRealStatus": (instance, fmi2.fmi2LastSuccessfulTime, None),
            }
        else:
            wrong = {
                "fmi3GetInt32": (instance, None, 1, ctypes.byref(integer), 1),
                "fmi3SetInt32": (instance, one, 1, None, 1),
                "fmi3GetFMUState": (instance, None),
                "fmi3SetFMUState": (instance, None),
                "fmi3SetDebugLogging": (instance, True, 1, None),
                "fmi3SerializedFMUStateSize": (instance, None, None),
                "fmi3SerializeFMUState": (instance, None, (ctypes.c_ubyte * 1)(), 1),
                "fmi3DeserializeFMUState": (instance, (ctypes.c_ubyte * 1)(), 1, None),
                "fmi3DoStep": (instance, 0.0, 1.0, True, None, None, None, None),
            }
        for name, arguments in wrong.items():
            fmu.messages.clear()
            assert fmu.call(name, *arguments) == ERROR, name
            assert fmu.messages[0].startswith(name), fmu.messages
            assert re.search("missing|NULL|no state", fmu.messages[0]), fmu.messages
        assert fmu.save() == before


@EVERY_FORM
@EVERY_MODEL
@pytest.mark.parametrize(
    ("start", "size"),
    [(1e308, 1e308), (1e20, 1.0), (0.0, -1e-300), (0.0, 0.0), (0.0, np.nan), (np.nan, 1.0), (0.0, np.inf), (-1.0, 1.0)],
)
def test_step_must_end_later_at_a_finite_time(model, form, start, size) -> None:
    """1e20 s and 1 s are 1e20 s."""
    with started(model, form) as fmu:
        before = fmu.save()
        assert fmu.step(start, size) == (ERROR if form == "fmi2" else DISCARD)
        assert fmu.save() == before


@EVERY_FORM
@pytest.mark.parametrize("model", DEPOSITION_MODELS)
@pytest.mark.parametrize(("period", "size"), [(1e-9, 1e9), (5e-324, 1.0), (1.0, 1e15)])
def test_step_with_layers_without_end_is_refused(model, form, period, size) -> None:
    with Driver(model, form, 3, 2).start({"layer_period": period}) as fmu:
        before = fmu.save()
        assert fmu.step(0.0, size) == (ERROR if form == "fmi2" else DISCARD)
        assert "take shorter steps" in fmu.messages[-1]
        assert fmu.save() == before


@EVERY_FORM
@pytest.mark.parametrize("model", DEPOSITION_MODELS)
def test_layer_numbers_end_where_an_int32_does(model, form) -> None:
    last = 2**31 - 1
    with Driver(model, form, 3, 2).start({"layer_period": 1.0, "layer_command": last}) as fmu:
        assert fmu.step(0.0, 1.0) == (ERROR if form == "fmi2" else DISCARD)
        assert fmu.get("layers_printed") == last
    with Driver(model, form, 3, 2).start({"layer_period": 1.0, "layer_command": last - 4}) as fmu:
        assert fmu.step(0.0, 1.0) == OK
        assert fmu.get("layers_printed") == last - 3
    with Driver(model, form, 3, 2).start({"layer_command": last - 1}) as fmu:
        assert max(fmu.set("layer_command", last), fmu.step(0.0)) == OK
        assert fmu.get("layers_printed") == last


@EVERY_FORM
@pytest.mark.parametrize(
    ("model", "parameters"),
    [
        ("LayerDeposition", {"h1_a": 1e308}),
        ("LayerDeposition", {"h1_a": 1e308, "layer_period": 0.3}),  # several layers in a step
        ("VolumeAreaDeposition", {"mv_plus": 1e300, "mv_minus": -1e300, "pattern": [1, 0, 1, 1, 0, 1]}),
        ("LayerDeposition", {"h1_a": 1e308, "layer_duration": 2.0}),  # completed in a step without a command
        ("ProfileSensor", {"bias": 1e308, "drift_rate": 1e308, "scan_duration": 0.0}),
        ("ProfileSensor", {"bias": 1e308, "drift_rate": 1e308, "scan_duration": 2.0}),
    ],
)
def test_step_to_what_is_not_finite_is_not_taken(model, form, parameters) -> None:
    with Driver(model, form, 3, 2) as fmu:
        given = {name: np.reshape(value, (3, 2)) if np.ndim(value) else value for name, value in parameters.items()}
        fmu.start(given)
        status, sensor = OK, ("layers_printed", "layers_scanned")
        name, done = sensor if model == "ProfileSensor" else ("layer_command", "layers_printed")
        for _ in range(20):
            if "layer_period" not in parameters and fmu.get("status") == 0:
                assert fmu.set(name, fmu.get(done) + 1) == OK
            before = fmu.save()
            status = fmu.step(fmu.now)
            if status != OK:
                break
        assert status == (ERROR if form == "fmi2" else DISCARD)
        assert "the step was not taken" in fmu.messages[-1]
        assert fmu.save() == before
        assert all(np.isfinite(value).all() for value in fmu.outputs().values())


def test_messages_name_the_variable_the_cell_and_what_was_expected() -> None:
    with Driver("LayerDeposition", nx=4, ny=6) as fmu:
        pattern, pitch = fmu.references["pattern"], fmu.references["pitch"]
        kinds = np.ones((4, 6), np.int32)
        kinds[1, 3] = 7
        last = max(reference for each in fmu.references.values() for reference in each)
        one, real = (ctypes.c_uint * 1)(*pitch), (ctypes.c_double * 2)(1e-4, 1e-4)
        it = fmu.fmu.component
        for name, arguments, message in (
            ("setInt32", (pattern, kinds.ravel().tolist()), "pattern of cell (1, 3) is 7; expected 0 to 2; nothing"),
            ("setInt32", (pattern, [1, 1, 1]), "pattern takes 24 values; the call has only 3 left for it"),
            ("getInt32", (pitch,), "pitch is of type real, not integer"),
            ("getFloat64", ([10**6],), f"no variable with value reference 1000000; expected 0 to {last}"),
            ("fmi3SetFloat64", (it, one, 1, real, 2), "the variables take 1 values together; the call has 2"),
            ("fmi3SetFloat64", (it, one, 1, None, 1), "the call names 1 variables, but its values are missing"),
            ("fmi3SetFloat64", (it, None, 1, real, 1), "1 variables, but its value references are missing"),
            ("setDebugLogging", (True, ["logAll"]), "category is logAll; expected logStatusDiscard or logStatusError"),
        ):
            fmu.messages.clear()
            assert fmu.call(name, *arguments) in (DISCARD, ERROR)
            assert message in fmu.messages[0]
        assert fmu.call("setDebugLogging", True, ["logStatusDiscard", "logStatusError"]) == OK


@pytest.mark.parametrize("size", ["0x9x2", "9x0x2", "9x9x65", "9x9x0", "9x9", "9x9x2y", "9x9x2-mark", "99999x99999x2"])
def test_token_of_sizes_that_cannot_be_is_refused(size: str) -> None:
    with Driver("LayerController", "fmi3-fixed") as fmu:
        own = fmu.fmu.guid
        assert own.endswith("-9x9x2")
        token = own.removesuffix("9x9x2") + size
        made = fmi3.FMU3Slave(guid=token, unzipDirectory=fmu.fmu.unzipDirectory, modelIdentifier="LayerController")
        heard: list[str] = []
        with pytest.raises(Exception, match="Failed to instantiate"):
            made.instantiate(logMessage=lambda *given: heard.append(given[-1].decode()))
        assert "-NXxNYxN as in the modelDescription.xml" in heard[0]


@pytest.mark.parametrize("form", ["fmi3", "fmi3-fixed"])
def test_byte_that_is_no_boolean_is_refused(form) -> None:
    with started("LayerController", form) as fmu:
        before = fmu.save()
        reference = (ctypes.c_uint * 1)(fmu.references["layer_unknown"][0])
        byte = ctypes.cast((ctypes.c_ubyte * 1)(2), ctypes.POINTER(ctypes.c_bool))
        assert fmu.call("fmi3SetBoolean", fmu.fmu.component, reference, 1, byte, 1) == DISCARD
        assert "layer_unknown is 2; expected 0 to 1" in fmu.messages[-1]
        assert fmu.save() == before


@EVERY_FORM
def test_droplets_are_counted_up_to_what_an_int32_holds(form) -> None:
    """255 drops on each of 7 x 7 cells: the counter is full after 171,863 layers."""
    with Driver("LayerDeposition", form, 7, 7).start(
        {"drop_level": 255, "layer_period": 1.0, "h1_a": 0.0, "h2_a": 0.0, "h3_a": 0.0}
    ) as fmu:
        for time in range(0, 180_000, 10_000):
            assert fmu.step(float(time), 10_000.0) == OK
        assert fmu.get("droplets_a") == 2**31 - 1
        assert fmu.get("layers_printed") == 180_000
