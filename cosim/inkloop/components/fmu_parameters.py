"""The options of an FMU in a scenario: its parameters, with units in the keys, and values taken from the job."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from inkloop.component import Job
from inkloop.components.job_parameters import (
    factor_from_job,
    ink_parameters,
    parameters_from_job,
    region_parameters,
)
from inkloop.components.port_tables import OPTION
from inkloop.errors import FmuError, nearest
from inkloop.fmu import FmuDescription, Variable, describe
from inkloop.fmu_writer.export import INTERVALS, find_fmu
from inkloop.tables.messages import other_unit, scaled
from inkloop.units import Key, declared_key, key_of

JOB_PARAMETERS = "job_parameters"
"""Option: whether the job's own values (pitch, inks, passes, seed, ...) set the parameters of an FMU with these
names."""
FILE_KEYS = ("file", OPTION, JOB_PARAMETERS)
"""Options of `kind = "Fmu"` that are no parameters."""
FORMS = ("fmi3", "fmi3-fixed", "fmi2")
"""Values of the option `fmi` of our own FMUs; the first is the default."""
CONTROLLER = "LayerController"
"""The model that plans the layers."""


PRESETS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "ProfileSensor": {
        # line laser of Lu, Zheng, Mishra 2015, Fig. 17; repeatability taken as the standard deviation of a reading
        "laser": {"noise_std": 1e-6, "resolution": 0.1e-6, "scan_duration": 6.0},
        # optical profilometer of Wu, Chiu 2024: resolution along z; its noise is not given, the duration assumed
        "zeta-20": {"resolution": 0.04e-6, "scan_duration": 6.0},
        "exact": {"scan_duration": 0.0},
    }
}
"""Model -> preset -> parameter -> value; what is not named keeps the model's default."""


@dataclass(frozen=True, eq=False)
class Parsed:
    """Parameters resolved from options and job, and the errors of the options, one sentence each.

    parameters: in the units of the FMU as written, enumerations by name or number; structural: sizes that are given;
    sizes: all of them; values: parameters as arrays. With errors, values and sizes may lack some.
    """

    description: FmuDescription
    parameters: Mapping[str, object]
    structural: Mapping[str, int]
    sizes: Mapping[str, int]
    values: Mapping[str, NDArray[Any]]
    errors: list[str]


def parse_model(model: str, job: Job, options: Mapping[str, object]) -> Parsed:
    """The options of one of our FMUs; a preset gives what the table leaves out. Raises FmuError without the FMU."""
    form = options.get("fmi", FORMS[0])
    errors = [] if form in FORMS else [f"fmi is {form!r}; expected one of {', '.join(FORMS)}"]
    preset, wrong = preset_of(model, options.get("preset"))
    errors += wrong
    own_keys = ("fmi", "preset") if model in PRESETS else ("fmi",)
    parameters = _without(options, "fmi", "preset")
    if model == CONTROLLER:
        parameters, of_python = _without_python_options(parameters)
        errors += of_python
    parsed = parse(describe(find_fmu(model, FORMS[0])), job, parameters, own_keys, defaults=preset)
    return replace(parsed, errors=errors + parsed.errors)


def parse_file(description: FmuDescription, job: Job, options: Mapping[str, object]) -> Parsed:
    """The options of `kind = "Fmu"` for the FMU that its `file` names."""
    use_job_parameters = options.get(JOB_PARAMETERS) is not False
    own = _without(options, *FILE_KEYS)
    return parse(description, job, own, FILE_KEYS, use_job_parameters=use_job_parameters, key_of=declared_key)


def values_of_file(description: FmuDescription, job: Job, options: Mapping[str, object]) -> dict[str, NDArray[Any]]:
    """Resolved parameters of valid options and the job for any FMU file; sizes only where they differ from its own."""
    parsed = parse_file(description, job, options)
    changed = {name: size for name, size in parsed.sizes.items() if size != description.default_sizes[name]}
    sizes = {name: description.parameters[name].convert(size, parsed.sizes) for name, size in changed.items()}
    return {**sizes, **parsed.values}


def parse(
    description: FmuDescription,
    job: Job,
    options: Mapping[str, object],
    other_keys: tuple[str, ...],
    *,
    defaults: Mapping[str, object] | None = None,
    use_job_parameters: bool = True,
    key_of: Callable[[str, str], Key] = key_of,
) -> Parsed:
    """The options of an FMU by its own description. other_keys: options that are no parameters, to suggest.

    defaults: values of parameters that neither the job nor an option gives; key_of: the key of a name and its unit.
    """
    known = description.parameters
    from_job = parameters_from_job(job) if use_job_parameters else {}
    errors: list[str] = []
    intervals: dict[str, int] = {}
    if INTERVALS in description.variables and use_job_parameters:
        of_region, intervals, wrong = region_parameters(description, job, options.get(INTERVALS))
        from_job |= ink_parameters(job) | of_region
        errors += wrong
    has_grid = description.grid is not None or "nx" in description.default_sizes
    structural: dict[str, int] = {"nx": job.nx, "ny": job.ny} | intervals if has_grid else {}
    parameters = dict(defaults or {})
    parameters |= {
        name: scaled(from_job[name], factor)
        for name, variable in known.items()
        if name in from_job
        and name not in structural
        and not variable.is_structural
        and (factor := factor_from_job(name, variable))
    }
    keys = {key.text: (variable, key) for variable in known.values() for key in [key_of(variable.name, variable.unit)]}
    written: dict[str, Key] = {}
    given: dict[str, object] = {}
    for option, value in options.items():
        if option not in keys:
            plain = other_unit(option, value, keys)
            errors.append(
                plain or f"{option} is no option of {description.name}; {nearest(option, (*keys, *other_keys))}"
            )
            continue
        variable, key = keys[option]
        written[variable.name] = key
        given[variable.name] = scaled(value, key.factor)
        if not variable.is_size:
            parameters[variable.name] = given[variable.name]
        elif isinstance(value, int):
            structural[variable.name] = value
    try:
        sizes = description.sizes(structural)
    except FmuError as error:
        return Parsed(description, parameters, structural, {}, {}, [*errors, f"kind: {error}"])
    for name, key in written.items():
        errors += _value_errors(known[name], key, given[name], options[key.text], sizes)
    values: dict[str, NDArray[Any]] = {}
    for name, number in parameters.items():
        try:
            values[name] = known[name].convert(number, sizes)
        except ValueError as error:
            if name not in written:
                errors.append(f"kind: {name} {error}; the job gives it, not this table")
    return Parsed(description, parameters, structural, sizes, values, errors)


def _value_errors(variable: Variable, key: Key, value: object, found: object, sizes: Mapping[str, int]) -> list[str]:
    """The error of a value, given as `found` in the unit of its key."""
    for checked, number in ((variable.in_unit(key.unit, key.factor), found), (variable, value)):
        try:
            checked.convert(number, sizes)
        except ValueError as error:
            return [f"{key.text} {error}" + (f" ({variable.description})" if variable.description else "")]
    return []


def _without(options: Mapping[str, object], *keys: str) -> dict[str, object]:
    return {name: value for name, value in options.items() if name not in keys}


_INSTEAD: Mapping[str, str] = {
    "sweeps": "write sweeps_max",
    "dead_nozzles": "mark the cells that nozzles reach in jettable",
    "nozzle_pitch": "mark the cells that nozzles reach in jettable",
    "threads": "it plans on one thread; leave it out",
    "device": "it plans on the processor; leave it out, or take kind 'LayerMpc'",
    "relaxation": "it relaxes by projected gradients; leave it out, or take kind 'LayerMpc'",
    "certified": "it proves no bound; take kind 'LayerMpc' for one",
}


def options_of_controller_fmu(options: Mapping[str, object]) -> dict[str, object]:
    """The options of LayerMpc by the names that LayerController has for them: its output is called sweeps."""
    return {"sweeps_max" if key == "sweeps" else key: value for key, value in options.items()}


def _without_python_options(options: Mapping[str, object]) -> tuple[dict[str, object], list[str]]:
    """The remaining options for the FMU, and the errors of the others."""
    errors = [f"{key} is no option of LayerController; {_INSTEAD[key]}" for key in options if key in _INSTEAD]
    left = {key: value for key, value in options.items() if key not in _INSTEAD}
    if isinstance(left.get("alpha"), list):
        del left["alpha"]
        errors.append(
            "alpha is a schedule; LayerController takes one number: take kind 'LayerMpc' for a schedule, or a master "
            "that sets alpha between steps"
        )
    return left, errors


def preset_of(model: str, name: object) -> tuple[Mapping[str, float], list[str]]:
    """Values of a model's preset (none without a name), and the error of a wrong name."""
    presets = PRESETS.get(model, {})
    if name is None:
        return {}, []
    if not presets:
        return {}, [f"preset is {name!r}; {model} has no presets"]
    if not isinstance(name, str) or name not in presets:
        return {}, [f"preset is {name!r}; expected one of {', '.join(presets)}"]
    return presets[name], []
