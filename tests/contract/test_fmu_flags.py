"""Every flag of our FMUs, declared or left at the standard's default, has a check here or a test elsewhere.

The flags are taken from the schema of the standard: one that is new, or that changes its value, fails until it has a
check. What an FMU does not offer is asked for as well: the answer is an error with a message, and nothing changes.
"""

from __future__ import annotations

import ast
import ctypes
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy import fmi2, fmi3
from lxml import etree

from support.fmus.fmu_driver import DISCARD, ERROR, EVERY_FORM, FIXED_REALS, FORMS, MODELS, OK, Driver, callbacks
from support.fmus.fmu_library import BAKED, HEADERS, JOB, archive_of, described
from support.fmus.fmu_life import EVERY_MODEL, offer, started
from support.fmus.layer_jobs import block

SCHEMAS = {
    2: HEADERS.parent / "schema/fmi2/fmi2ModelDescription.xsd",
    3: HEADERS.parent / "schema/fmi3/fmi3InterfaceType.xsd",
}
XSD = "{http://www.w3.org/2001/XMLSchema}"
Check = Callable[[str, str], None]
BLOCKS = [(JOB, form) for form in ("fmi3-fixed", "fmi2")]
EVERY_FMU = pytest.mark.parametrize(("model", "form"), [*((m, form) for m in MODELS for form in FORMS), *BLOCKS])
FIXED = {**FIXED_REALS, JOB: "layer_period"}


def opened(model: str, form: str) -> Driver:
    """An instance in Step Mode; a print in one block is that of a scenario."""
    return block(form, *BAKED).start() if model == JOB else started(model, form)


def give(fmu: Driver, layer: int) -> None:
    """Inputs with which the next step has something to do; a print in one block has enough to do by itself."""
    if "start" not in fmu.references:
        offer(fmu, layer)


def refuses(fmu: Driver, method: str, *arguments: Any, message: str = "modelDescription.xml") -> None:
    """The call is an error with a message, and changes nothing."""
    before = fmu.save()
    fmu.messages.clear()
    assert fmu.call(method, *arguments) == ERROR, method
    assert fmu.messages, f"{method} gives no message"
    assert message in fmu.messages[0], fmu.messages
    assert fmu.save() == before, method


def output_of(fmu: Driver) -> list[int]:
    """The value reference of a real output."""
    return next(
        fmu.references[name][:1]
        for name, role in fmu.roles.items()
        if role == "output" and fmu.types[name] in ("Real", "Float64")
    )


def any_sizes_of_steps_lead_to_the_same_outputs(model: str, form: str) -> None:
    ends = []
    for sizes in ([3.0], [1.0, 1.0, 1.0], [0.1, 1.7, 1.2], [0.375] * 8):
        with opened(model, form) as fmu:
            for layer in range(1, 5):
                give(fmu, layer)
                for size in sizes:
                    assert fmu.step(fmu.now, size) == OK
            ends.append({name: value.tolist() for name, value in fmu.outputs().items() if name != "time"})
    assert all(end == ends[0] for end in ends)


def derivatives_are_refused(model: str, form: str) -> None:
    with opened(model, form) as fmu:
        output, parameter = output_of(fmu), fmu.references[FIXED[model]]
        refuses(fmu, "getRealOutputDerivatives" if fmu.is_fmi2 else "getOutputDerivatives", output, [1])
        refuses(fmu, "getDirectionalDerivative", output, parameter, [1.0])
        if fmu.is_fmi2:
            refuses(fmu, "setRealInputDerivatives", parameter, [1], [0.0])
        else:
            refuses(fmu, "getAdjointDerivative", output, parameter, [1.0])


def steps_do_not_wait(model: str, form: str) -> None:
    """fmi2DoStep is done when it returns, so there is nothing to cancel and no step whose status could be asked for."""
    with opened(model, form) as fmu:
        give(fmu, 1)
        assert fmu.step(0.0) == OK
        refuses(fmu, "cancelStep")
        refuses(fmu, "getStatus", fmi2.fmi2DoStepStatus)
        refuses(fmu, "getStringStatus", fmi2.fmi2PendingStatus)
        assert fmu.fmu.getRealStatus(fmi2.fmi2LastSuccessfulTime) == 1.0
        assert not fmu.fmu.getBooleanStatus(fmi2.fmi2Terminated)
        refuses(fmu, "getBooleanStatus", fmi2.fmi2LastSuccessfulTime)
        refuses(fmu, "getRealStatus", fmi2.fmi2Terminated)


def it_lives_without_memory_functions(model: str, form: str) -> None:
    """The callbacks of the driver have none."""
    made = callbacks([])
    assert not made.allocateMemory
    assert not made.freeMemory
    with opened(model, form) as fmu:
        assert not fmu.callbacks.allocateMemory
        assert fmu.restore(fmu.save()) == OK


def instantiated(model: str, **options: Any) -> tuple[Any, list[str]]:
    """An FMI 3 instance as asked for, None if it is refused, and what was logged."""
    messages: list[str] = []
    with opened(model, "fmi3-fixed") as driver:
        made = fmi3.FMU3Slave(guid=driver.fmu.guid, unzipDirectory=driver.fmu.unzipDirectory, modelIdentifier=model)
        try:
            made.instantiate(logMessage=lambda _, status, category, text: messages.append(text.decode()), **options)
        except Exception:
            return None, messages
    return made, messages


def steps_never_return_early_nor_call_back(model: str, form: str) -> None:
    called: list[object] = []
    made, messages = instantiated(model, requiredIntermediateVariables=[3])
    assert made is None
    assert "no intermediate variables" in messages[0]
    made, _ = instantiated(
        model, earlyReturnAllowed=True, intermediateUpdate=lambda *arguments: called.append(arguments)
    )
    made.enterInitializationMode()
    made.exitInitializationMode()
    for time in (0.0, 2.0, 4.0):
        assert made.doStep(time, 2.0) == (False, False, False, time + 2.0)
    assert called == []
    made.freeInstance()


def there_is_no_event_mode(model: str, form: str) -> None:
    made, messages = instantiated(model, eventModeUsed=True)
    assert made is None
    assert "hasEventMode" in messages[0]
    with opened(model, form) as fmu:
        refuses(fmu, "enterEventMode")
        refuses(fmu, "updateDiscreteStates")
        refuses(fmu, "enterStepMode", message="no Event Mode")
        refuses(fmu, "fmi3EvaluateDiscreteStates", fmu.fmu.component)


def dependencies_at_run_time_are_refused(model: str, form: str) -> None:
    with opened(model, form) as fmu:
        instance, output = fmu.fmu.component, output_of(fmu)[0]
        refuses(fmu, "fmi3GetNumberOfVariableDependencies", instance, output, ctypes.byref(ctypes.c_size_t()))
        refuses(fmu, "fmi3GetVariableDependencies", instance, output, None, None, None, None, 0)


MANY_INSTANCES = "test_fmu_state.py::test_instances_in_parallel_threads_are_like_one_after_the_other"
STATE_IN_MEMORY = "test_fmu_state.py::test_states_in_memory_stand_beside_each_other"
STATE_AS_BYTES = "test_fmu_state.py::test_run_replays_from_a_saved_state_bit_by_bit"
NEEDS_NOTHING = "test_fmu_archive.py::test_binary_has_the_standards_functions_and_needs_the_c_library"
CHECKS: dict[int, dict[tuple[str, str], Check | str]] = {
    2: {
        ("needsExecutionTool", "false"): NEEDS_NOTHING,
        ("canHandleVariableCommunicationStepSize", "true"): any_sizes_of_steps_lead_to_the_same_outputs,
        ("canInterpolateInputs", "false"): derivatives_are_refused,
        ("maxOutputDerivativeOrder", "0"): derivatives_are_refused,
        ("canRunAsynchronuously", "false"): steps_do_not_wait,
        ("canBeInstantiatedOnlyOncePerProcess", "false"): MANY_INSTANCES,
        ("canNotUseMemoryManagementFunctions", "true"): it_lives_without_memory_functions,
        ("canGetAndSetFMUstate", "true"): STATE_IN_MEMORY,
        ("canSerializeFMUstate", "true"): STATE_AS_BYTES,
        ("providesDirectionalDerivative", "false"): derivatives_are_refused,
    },
    3: {
        ("needsExecutionTool", "false"): NEEDS_NOTHING,
        ("canBeInstantiatedOnlyOncePerProcess", "false"): MANY_INSTANCES,
        ("canGetAndSetFMUState", "true"): STATE_IN_MEMORY,
        ("canSerializeFMUState", "true"): STATE_AS_BYTES,
        ("providesDirectionalDerivatives", "false"): derivatives_are_refused,
        ("providesAdjointDerivatives", "false"): derivatives_are_refused,
        ("providesPerElementDependencies", "false"): dependencies_at_run_time_are_refused,
        ("canHandleVariableCommunicationStepSize", "true"): any_sizes_of_steps_lead_to_the_same_outputs,
        ("fixedInternalStepSize", "none"): any_sizes_of_steps_lead_to_the_same_outputs,
        ("maxOutputDerivativeOrder", "0"): derivatives_are_refused,
        ("recommendedIntermediateInputSmoothness", "0"): steps_never_return_early_nor_call_back,
        ("providesIntermediateUpdate", "false"): steps_never_return_early_nor_call_back,
        ("mightReturnEarlyFromDoStep", "false"): steps_never_return_early_nor_call_back,
        ("canReturnEarlyAfterIntermediateUpdate", "false"): steps_never_return_early_nor_call_back,
        ("hasEventMode", "false"): there_is_no_event_mode,
        ("providesEvaluateDiscreteStates", "false"): there_is_no_event_mode,
    },
}
OWN = [
    (model, form, check)
    for model, form in EVERY_FMU.args[1]
    for check in dict.fromkeys(CHECKS[int(form[3])].values())
    if not isinstance(check, str)
]


@cache
def defaults(version: int) -> dict[str, str]:
    """Every flag that the standard knows for co-simulation, with the value that it has where nothing is declared."""
    root = etree.parse(SCHEMAS[version]).getroot()
    if version == 2:
        (element,) = root.iterfind(f".//{XSD}element[@name='CoSimulation']")
        attributes = list(element.find(f"{XSD}complexType").iterchildren(f"{XSD}attribute"))
    else:
        types = {entry.get("name"): entry for entry in root.iter(f"{XSD}complexType")}
        attributes = [
            a for name in ("fmi3InterfaceType", "fmi3CoSimulation") for a in types[name].iter(f"{XSD}attribute")
        ]
    return {a.get("name"): a.get("default", "none") for a in attributes}


@EVERY_FMU
def test_every_flag_has_a_check(model: str, form: str) -> None:
    version = int(form[3])
    declared = dict(described(archive_of(model, form)).find("CoSimulation").attrib)
    assert declared.pop("modelIdentifier") == model
    flags = {name: value for name, value in {**defaults(version), **declared}.items() if name != "modelIdentifier"}
    assert set(flags.items()) == set(CHECKS[version])


@pytest.mark.parametrize(
    ("model", "form", "check"), OWN, ids=[f"{m}-{form}-{check.__name__}" for m, form, check in OWN]
)
def test_flag_is_kept(model: str, form: str, check: Check) -> None:
    check(model, form)


ELSEWHERE = sorted({check for checks in CHECKS.values() for check in checks.values() if isinstance(check, str)})


@pytest.mark.parametrize("check", ELSEWHERE)
def test_flag_that_is_shown_elsewhere_is_shown_for_every_model_and_form(check: str) -> None:
    file, name = check.split("::")
    body = ast.parse((Path(__file__).parent / file).read_text(encoding="utf-8")).body
    (test,) = (node for node in body if isinstance(node, ast.FunctionDef) and node.name == name)
    assert {"EVERY_MODEL", "EVERY_FORM"} <= {mark.id for mark in test.decorator_list if isinstance(mark, ast.Name)}


@EVERY_FMU
def test_co_simulation_is_the_only_interface_and_others_are_refused_with_a_message(model: str, form: str) -> None:
    interfaces = {"CoSimulation", "ModelExchange", "ScheduledExecution"}
    assert [e.tag for e in described(archive_of(model, form)) if e.tag in interfaces] == ["CoSimulation"]
    messages: list[str] = []
    with opened(model, form) as driver:
        own = driver.fmu
        if driver.is_fmi2:
            made = callbacks(messages)
            names = (b"it", fmi2.fmi2ModelExchange, own.guid.encode(), b"")
            assert own.fmi2Instantiate(*names, ctypes.byref(made), False, False) is None
            assert len(messages) == 1
        else:
            log = fmi3.fmi3LogMessageCallback(lambda _, status, category, text: messages.append(text.decode()))
            first = (b"it", own.guid.encode(), b"", False, False, None, log)
            assert own.fmi3InstantiateModelExchange(*first) is None
            nothing = (
                fmi3.fmi3ClockUpdateCallback(),
                fmi3.fmi3LockPreemptionCallback(),
                fmi3.fmi3UnlockPreemptionCallback(),
            )
            assert own.fmi3InstantiateScheduledExecution(*first, *nothing) is None
            assert len(messages) == 2
    assert all("for co-simulation only" in message for message in messages)


@EVERY_FORM
@EVERY_MODEL
def test_values_outside_the_declared_limits_are_refused(model: str, form: str) -> None:
    """And nothing inside them is, at the least value of a real."""
    described_limits = 0
    with Driver(model, form, 3, 2) as fmu:
        before = fmu.save()
        for variable in fmpy.read_model_description(fmu.fmu.unzipDirectory).modelVariables:
            name = variable.name.partition("[")[0]
            if fmu.roles[name] not in ("input", "parameter") or variable.type in ("Boolean", "Enumeration"):
                continue
            number = float if variable.type in ("Real", "Float64") else int
            for limit, outside in ((variable.min, -math.inf), (variable.max, math.inf)):
                if limit is None:
                    continue
                described_limits += 1
                value = number(limit)
                beyond = math.nextafter(value, outside) if number is float else value + int(math.copysign(1, outside))
                if -(2**31) <= beyond < 2**31:
                    assert fmu.set(name, beyond) == DISCARD, (name, beyond)
                    assert fmu.save() == before
        assert described_limits > 10


@EVERY_FMU
def test_parameters_are_fixed_or_tunable_as_declared(model: str, form: str) -> None:
    with opened(model, form) as fmu:
        for variable in fmpy.read_model_description(fmu.fmu.unzipDirectory).modelVariables:
            name = variable.name.partition("[")[0]
            if variable.causality == "parameter":
                assert fmu.set(name, fmu.get(name)) == (OK if variable.variability == "tunable" else ERROR), name


@EVERY_FORM
@EVERY_MODEL
def test_last_of_several_values_of_an_input_counts(model: str, form: str) -> None:
    """canHandleMultipleSetPerTimeInstant, which is true where nothing is declared."""
    states = []
    for offers in ([2, 1], [1]):
        with opened(model, form) as fmu:
            for name, role in fmu.roles.items():
                if role == "input" and len(offers) == 2:
                    assert fmu.set(name, fmu.get(name)) == OK
            if len(offers) == 2 and "volume_factor" in fmu.references:
                assert fmu.set("volume_factor", 0.25) == OK
                assert fmu.set("volume_factor", 1.0) == OK
            give(fmu, offers[-1])
            assert fmu.step(0.0, 3.0) == OK
            states.append(fmu.save())
    assert states[0] == states[1]
