"""The C of a variables.toml: the table that the adapters walk, and the struct that the kernel reads."""

from __future__ import annotations

from collections.abc import Iterator

from inkloop.fmu_writer.definition import ModelDefinition, VariableDefinition, c_causality

_C_TYPES = {"real": "double", "integer": "int32_t", "boolean": "bool", "enumeration": "int64_t", "count": "uint64_t"}
_WRITTEN_BY_KERNEL = ("output", "state", "scratch")
_ORIGIN = "/* Written from variables.toml; change that. */"


def file_names(model: ModelDefinition) -> tuple[str, str]:
    """Of header and table; each model has its own, so that several stand in one binary."""
    name = _snake(model.name)
    return f"{name}_variables.h", f"{name}_variables.c"


def header(model: ModelDefinition) -> str:
    """The header: the model, the numbers of its variables, and a struct of pointers into an instance."""
    name = _snake(model.name)
    guard = f"INKLOOP_{name.upper()}_VARIABLES_H"
    numbers = (f"    {_number(model, v)}," for v in model.variables)
    fields = (f"    {_pointer(v)}{v.name};" for v in model.variables)
    binds = (f"        .{v.name} = values_of(instance, {_number(model, v)})," for v in model.variables)
    return "\n".join(
        [
            _ORIGIN,
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            '#include "kernel.h"',
            "",
            f"extern const Model {name.upper()};",
            f"extern const VariableTable {name.upper()}_VARIABLES;",
            "",
            "enum {",
            *numbers,
            "};",
            "",
            "typedef struct {",
            *fields,
            f"}} {model.name}Variables;",
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
    """The table itself."""
    table = f"{_snake(model.name).upper()}_VARIABLES"
    return "\n".join(
        [
            _ORIGIN,
            f'#include "{file_names(model)[0]}"',
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
    """fmu_model.c: which model an FMU offers."""
    return "\n".join(
        [
            _ORIGIN,
            '#include "lifecycle.h"',
            f'#include "{file_names(model)[0]}"',
            "",
            f"const Model *const FMU_MODEL = &{_snake(model.name).upper()};",
            "",
        ]
    )


def _rows(model: ModelDefinition) -> Iterator[str]:
    for v in model.variables:
        low, high = model.limits(v)
        limits = f"{_limit(low, '-INFINITY')}, {_limit(high, 'INFINITY')}"
        grid = "true" if v.is_grid else "false"
        yield f'    {{"{v.name}", TYPE_{v.type.upper()}, {c_causality(v).upper()}, {grid}, {v.start!r}, {limits}}},'


def _pointer(variable: VariableDefinition) -> str:
    constant = "" if variable.causality in _WRITTEN_BY_KERNEL else "const "
    return f"{constant}{_C_TYPES[variable.type]} *"


def _number(model: ModelDefinition, variable: VariableDefinition) -> str:
    return f"{_snake(model.name)}_{variable.name}".upper()


def _limit(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else repr(value)


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).removeprefix("_")
