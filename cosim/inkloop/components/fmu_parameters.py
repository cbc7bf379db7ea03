"""The options of an FMU in a scenario: its parameters, with units in the keys, and what the job says by itself."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from inkloop.component import Job
from inkloop.components.job_parameters import region_intervals
from inkloop.components.port_mapping import MappedPorts
from inkloop.components.port_tables import OPTION, make_mapped, mapped_ports
from inkloop.components.presets import PRESETS, preset_of
from inkloop.errors import FmuError
from inkloop.fmu import FmuComponent, FmuDescription, Variable, describe, platform_fault
from inkloop.fmu.archive_member import fmu_file
from inkloop.fmu_writer.export import export, find_fmu
from inkloop.suggest import nearest
from inkloop.tables.quantities import scaled
from inkloop.units import conversion, missing_suffix, spellings, unit_of

JOB_PARAMETERS = "job_parameters"
"""Whether the job's own values (pitch, inks, passes, seed, ...) go to parameters of an FMU that bear their names."""
_FILE_KEYS = ("file", OPTION, JOB_PARAMETERS)
FORMS = ("fmi3", "fmi3-fixed", "fmi2")
"""Values of the option `fmi` of our own FMUs; the first is the default."""
CONTROLLER = "LayerController"
"""The model that plans the layers."""


_LENGTHS = frozenset({"pitch", "target_height", "height_start"})


@dataclass(frozen=True)
class _Parsed:
    """What the options come to: values in SI, sizes, and what is wrong."""

    parameters: Mapping[str, object]
    structural: Mapping[str, int]
    faults: list[str]


def faults_of_model(model: str, job: Job, options: Mapping[str, object]) -> list[str]:
    """Everything wrong with the options of one of our FMUs. Raises FmuError if it is not there."""
    form = options.get("fmi", FORMS[0])
    wrong = [] if form in FORMS else [f"fmi is {form!r}; expected one of {', '.join(FORMS)}"]
    return wrong + _parse_model(model, job, options).faults


def make_model(model: str, job: Job, options: Mapping[str, object]) -> FmuComponent:
    """One of our FMUs, with faultless options; where its grid is fixed to another size, one made for the job."""
    form = str(options.get("fmi", FORMS[0]))
    parsed = _parse_model(model, job, options)
    found = find_fmu(model, form)
    sizes = parsed.structural
    if form == "fmi3" or describe(found).grid == (sizes["nx"], sizes["ny"]):
        return FmuComponent(found, parameters=parsed.parameters, structural=sizes)
    with tempfile.TemporaryDirectory(prefix="inkloop-export-") as folder:  # a component keeps what it needs of the file
        made = export(model, fmi="2" if form == "fmi2" else "3", nx=sizes["nx"], ny=sizes["ny"], fixed=True,
                      out=Path(folder) / f"{model}.fmu")  # fmt: skip
        return FmuComponent(made, parameters=parsed.parameters, structural=sizes)


def values_of_model(model: str, job: Job, options: Mapping[str, object]) -> dict[str, NDArray[Any]]:
    """What faultless options and the job come to: by parameter its value in SI, enumerations as numbers."""
    parsed = _parse_model(model, job, options)
    description = describe(find_fmu(model, FORMS[0]))
    sizes = description.sizes(parsed.structural)
    return {name: description.parameters[name].convert(value, sizes) for name, value in parsed.parameters.items()}


def faults_of_file(job: Job, options: Mapping[str, object]) -> list[str]:
    """Everything wrong with the options of `kind = "Fmu"`. Raises FmuError if the file cannot be read."""
    if not isinstance(options.get("file"), str):
        return ["file is missing; name the .fmu file"]
    with fmu_file(Path(str(options["file"]))) as path:
        description = describe(path)
    fault = platform_fault(description)
    wrong = [f"file is {options['file']!r}, which {fault}"] if fault else []
    if not isinstance(asked := options.get(JOB_PARAMETERS, True), bool):
        wrong.append(f"{JOB_PARAMETERS} is {asked!r}; expected true or false")
    parsed = _parse_file(description, job, options)
    if OPTION in options and not parsed.faults:
        sizes = description.sizes(parsed.structural)
        inputs, outputs = description.ports("input", sizes), description.ports("output", sizes)
        wrong += mapped_ports(inputs, outputs, job, options[OPTION])[2]
    return wrong + parsed.faults


def make_from_file(job: Job, options: Mapping[str, object]) -> FmuComponent | MappedPorts:
    """Any FMU file, with faultless options."""
    with fmu_file(Path(str(options["file"]))) as path:  # a component keeps what it needs of the file
        parsed = _parse_file(describe(path), job, options)
        fmu = FmuComponent(path, parameters=parsed.parameters, structural=parsed.structural)
    return make_mapped(fmu, job, options[OPTION]) if OPTION in options else fmu


def values_of_file(description: FmuDescription, job: Job, options: Mapping[str, object]) -> dict[str, NDArray[Any]]:
    """What faultless options and the job come to for any FMU file; sizes only where they are not its own."""
    parsed = _parse_file(description, job, options)
    sizes = description.sizes(parsed.structural)
    changed = {name: size for name, size in sizes.items() if size != description.default_sizes[name]}
    values = {**changed, **parsed.parameters}
    return {name: description.parameters[name].convert(value, sizes) for name, value in values.items()}


def _parse_model(model: str, job: Job, options: Mapping[str, object]) -> _Parsed:
    """The options of one of our FMUs; a preset stands where the table says nothing."""
    preset, wrong = preset_of(model, options.get("preset"))
    own_keys = ("fmi", "preset") if model in PRESETS else ("fmi",)
    parameters = _without(options, "fmi", "preset")
    if model == CONTROLLER:
        parameters, of_python = _without_python_options(parameters)
        wrong = wrong + of_python
    parsed = _parse(describe(find_fmu(model, "fmi3")), job, parameters, own_keys)
    return replace(parsed, parameters={**preset, **parsed.parameters}, faults=wrong + parsed.faults)


def _parse_file(description: FmuDescription, job: Job, options: Mapping[str, object]) -> _Parsed:
    told = options.get(JOB_PARAMETERS) is not False
    return _parse(description, job, _without(options, *_FILE_KEYS), _FILE_KEYS, told)


def _parse(
    description: FmuDescription,
    job: Job,
    options: Mapping[str, object],
    other_keys: tuple[str, ...],
    is_told: bool = True,
) -> _Parsed:
    known = description.parameters
    told = _told_by_job(job) if is_told else {}
    faults: list[str] = []
    if "region_bottom_1" in known and is_told:
        try:
            told |= _told_of_inks(job)
        except ValueError as error:
            faults.append(f"kind is {description.name!r}: {error}; take 'LayerMpc'")
    has_grid = description.grid is not None or "nx" in description.default_sizes
    structural: dict[str, int] = {"nx": job.nx, "ny": job.ny} if has_grid else {}
    parameters = {name: scaled(told[name], factor) for name, variable in known.items()
                  if name in told and name not in structural and (factor := _factor(name, variable))}  # fmt: skip
    keys = {key: (variable, factor) for variable in known.values()
            for key, factor in spellings(variable.name, variable.unit).items()}  # fmt: skip
    written: dict[str, str] = {}
    values: dict[str, object] = {}
    for key, value in options.items():
        if key not in keys:
            plain = missing_suffix(key, known[key].unit) if key in known else None
            listed = [next(iter(spellings(name, known[name].unit))) for name in known]
            advice = nearest(key, (*keys, *other_keys), listed=(*listed, *other_keys))
            faults.append(plain or f"{key} is no option of {description.name}; {advice}")
            continue
        variable, factor = keys[key]
        if variable.name in written:
            faults.append(f"{key} says again what {written[variable.name]} says; keep one")
        written[variable.name] = key
        values[variable.name] = scaled(value, factor)
        if variable.causality != "structuralParameter":
            parameters[variable.name] = values[variable.name]
        elif isinstance(value, int):
            structural[variable.name] = value
    try:
        sizes = description.sizes(structural)
    except FmuError as error:
        return _Parsed(parameters, structural, [*faults, f"kind: {error}"])
    for name, key in written.items():
        faults += _value_faults(known[name], key, values[name], options[key], sizes)
    return _Parsed(parameters, structural, faults)


def _value_faults(variable: Variable, key: str, value: object, found: object, sizes: Mapping[str, int]) -> list[str]:
    """What is wrong with a value, which is `found` in the unit of its key, told in that unit."""
    written = variable.in_unit(*unit_of(key, variable.name, variable.unit))
    for checked, number in ((written, found), (variable, value)):
        try:
            checked.convert(number, sizes)
        except ValueError as error:
            return [f"{key} {error}" + (f" ({variable.description})" if variable.description else "")]
    return []


def _told_by_job(job: Job) -> dict[str, Any]:
    """What the job says under the names that FMUs use for it."""
    inks = {f"h{order}_{letter}": getattr(ink, f"h{order}")
            for letter, ink in zip("ab", job.inks, strict=False) for order in (1, 2, 3)}  # fmt: skip
    told = ("nx", "ny", "pitch", "target_height", "mask", "passes", "pass_order", "pass_rotation", "seed")
    surface = {} if job.height_start is None else {"height_start": job.height_start}
    return {name: getattr(job, name) for name in told} | inks | surface


def _factor(name: str, variable: Variable) -> float | None:
    """From the job's number to the FMU's; None where the FMU means something else by the name."""
    is_length = name in _LENGTHS or name.startswith(("h1_", "h2_", "h3_", "region_bottom_", "region_top_"))
    is_other_type = name == "pass_order" and not variable.items
    return None if is_other_type else conversion("m" if is_length else "1", variable.unit)


def _told_of_inks(job: Job) -> dict[str, Any]:
    """What the job says of its inks to who chooses between them."""
    return {"inks": len(job.inks), "has_region": job.region is not None, **region_intervals(job)}


def _without(options: Mapping[str, object], *keys: str) -> dict[str, object]:
    return {name: value for name, value in options.items() if name not in keys}


_INSTEAD: Mapping[str, str] = {
    "sweeps": "write sweeps_max",
    "dead_nozzles": "mark the cells that nozzles reach in jettable",
    "nozzle_pitch": "mark the cells that nozzles reach in jettable",
    "threads": "it plans on one thread; leave it out",
    "relaxation": "it relaxes by projected gradients; leave it out, or take kind 'LayerMpc'",
    "certified": "it proves no bound; take kind 'LayerMpc' for one",
}


def options_of_controller_fmu(options: Mapping[str, object]) -> dict[str, object]:
    """The options of LayerMpc by the names that LayerController has for them: its output is called sweeps."""
    return {"sweeps_max" if key == "sweeps" else key: value for key, value in options.items()}


def _without_python_options(options: Mapping[str, object]) -> tuple[dict[str, object], list[str]]:
    """The options that are left for the FMU, and what is wrong with the others."""
    faults = [f"{key} is no option of LayerController; {_INSTEAD[key]}" for key in options if key in _INSTEAD]
    left = {key: value for key, value in options.items() if key not in _INSTEAD}
    if isinstance(left.get("alpha"), list):
        del left["alpha"]
        faults.append(
            "alpha is a schedule; LayerController takes one number: take kind 'LayerMpc' for a schedule, or a master "
            "that sets alpha between steps"
        )
    return left, faults
