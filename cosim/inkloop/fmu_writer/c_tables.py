"""The C of a variables.toml: the table that the adapters walk, the struct that the kernel reads, and the emulator's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from inkloop.fmu_writer.definition import ModelDefinition, VariableDefinition, c_causality

_C_TYPES = {"real": "double", "integer": "int32_t", "boolean": "bool", "enumeration": "int64_t", "count": "uint64_t"}
_C_TYPES |= {"clock": "bool", "string": "struct ByteString", "binary": "struct ByteString"}
_EMULATOR_TYPES = {"real": "REAL", "integer": "SIGNED32", "enumeration": "KIND"}
_WRITTEN_BY_KERNEL = ("output", "state", "scratch")
_ORIGIN = "/* Written from variables.toml; change that. */"


def files(model: ModelDefinition) -> dict[str, str]:
    """Names and texts of the files of a model; each model has its own names, so that several stand in one binary."""
    name = _snake(model.name)
    texts = {"values.h": values_header(model), "variables.h": header(model), "variables.c": source(model)}
    return {f"{name}_{end}": text for end, text in texts.items()}


def values_header(model: ModelDefinition) -> str:
    """The struct of pointers to the values of all variables, independent of FMI headers."""
    name = _snake(model.name)
    guard = f"INKLOOP_{name.upper()}_VALUES_H"
    fields = (f"    {_pointer(v)}{v.name};" for v in model.variables)
    return "\n".join(
        [
            _ORIGIN,
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            "#include <stdbool.h>",
            "#include <stdint.h>",
            "",
            "typedef struct {",
            *fields,
            f"}} {model.name}Variables;",
            "",
            "#endif",
            "",
        ]
    )


def header(model: ModelDefinition) -> str:
    """The header: the model, the numbers of its variables, and the struct of pointers into an instance."""
    name = _snake(model.name)
    guard = f"INKLOOP_{name.upper()}_VARIABLES_H"
    numbers = (f"    {_number(model, v)}," for v in model.variables)
    binds = (f"        .{v.name} = values_of(instance, {_number(model, v)})," for v in model.variables)
    return "\n".join(
        [
            _ORIGIN,
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            '#include "kernel.h"',
            f'#include "{name}_values.h"',
            "",
            f"extern const Model {name.upper()};",
            f"extern const VariableTable {name.upper()}_VARIABLES;",
            "",
            "enum {",
            *numbers,
            "};",
            "",
            f"static inline {model.name}Variables {name}_variables(Instance *instance) {{",
            f"    return ({model.name}Variables){{",
            *binds,
            "    };",
            "}",
            "",
            "#endif",
            "",
        ]
    )


def source(model: ModelDefinition) -> str:
    """The table of a model."""
    table = f"{_snake(model.name).upper()}_VARIABLES"
    return "\n".join(
        [
            _ORIGIN,
            f'#include "{_snake(model.name)}_variables.h"',
            "",
            "#include <math.h>",
            "",
            "static const VariableDefinition VARIABLES[] = {",
            *_rows(model),
            "};",
            "",
            f"const VariableTable {table} = {{",
            f'    "{model.name}", "{model.fingerprint}", VARIABLES, {len(model.variables)}, {len(model.exposed)}}};',
            "",
        ]
    )


def fmu_model(model: ModelDefinition) -> str:
    """fmu_model.c: the model of an FMU."""
    return "\n".join(
        [
            _ORIGIN,
            '#include "lifecycle.h"',
            f'#include "{_snake(model.name)}_variables.h"',
            "",
            f"const Model *const FMU_MODEL = &{_snake(model.name).upper()};",
            "",
        ]
    )


def emulated_parameters(models: Sequence[ModelDefinition]) -> str:
    """emulated_parameters.h: rows of the emulator's table of options, and start values, of the parameters that FMU and
    emulator share.

    A row is name, type, member of WorldOptions, smallest and largest value.
    """
    both = [(model, v) for model in models for v in model.emulated]
    rows = [f'{{"{v.name}", {_EMULATOR_TYPES[v.type]}, WORLD({v.emulated}), {_limits(m, v)}}}' for m, v in both]
    starts = [f".{v.emulated} = {v.start!r}" for _, v in both]
    return "\n".join([_ORIGIN, *_macro("EMULATED_PARAMETERS", rows), "", *_macro("EMULATED_STARTS", starts), ""])


def _macro(name: str, lines: Sequence[str]) -> Iterator[str]:
    yield f"#define {name} \\"
    yield from (f"    {line}, \\" for line in lines[:-1])
    yield f"    {lines[-1]}"


def _rows(model: ModelDefinition) -> Iterator[str]:
    for v in model.variables:
        shape = "ONE_VALUE" if not v.is_grid else "MAP" if v.along is None else "MAPS"
        role, clock = c_causality(v).upper(), _clock(model, v)
        yield f'    {{"{v.name}", TYPE_{v.type.upper()}, {role}, {shape}, {v.start!r}, {_limits(model, v)}, {clock}}},'


def _clock(model: ModelDefinition, variable: VariableDefinition) -> int:
    """Number of its clock; 0: not clocked."""
    return [v.name for v in model.variables].index(variable.clock) if variable.clock else 0


def _pointer(variable: VariableDefinition) -> str:
    constant = "" if variable.causality in _WRITTEN_BY_KERNEL else "const "
    return f"{constant}{_C_TYPES[variable.type]} *"


def _number(model: ModelDefinition, variable: VariableDefinition) -> str:
    return f"{_snake(model.name)}_{variable.name}".upper()


def _limits(model: ModelDefinition, variable: VariableDefinition) -> str:
    low, high = model.limits(variable)
    return f"{'-INFINITY' if low is None else repr(low)}, {'INFINITY' if high is None else repr(high)}"


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).removeprefix("_")
