"""variables.h and variables.c of a model: the table that the adapters walk and the struct that its kernel reads."""

from __future__ import annotations

from collections.abc import Iterator

from inkloop.model_definition import ModelDefinition, VariableDefinition, c_causality

_C_TYPES = {"real": "double", "integer": "int32_t", "boolean": "bool", "enumeration": "int64_t", "count": "uint64_t"}
_WRITTEN_BY_KERNEL = ("output", "state", "scratch")
_ORIGIN = "/* Written from variables.toml; change that. */"


def header(model: ModelDefinition) -> str:
    """variables.h: the numbers of the variables, and a struct of pointers into an instance."""
    guard = f"INKLOOP_{_snake(model.name).upper()}_VARIABLES_H"
    numbers = (f"    {_number(v)}," for v in model.variables)
    fields = (f"    {_pointer(v)}{v.name};" for v in model.variables)
    binds = (f"        .{v.name} = values_of(instance, {_number(v)})," for v in model.variables)
    return "\n".join(
        [
            _ORIGIN,
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            '#include "kernel.h"',
            "",
            "enum {",
            *numbers,
            "};",
            "",
            "typedef struct {",
            *fields,
            f"}} {model.name}Variables;",
            "",
            f"static inline {model.name}Variables {_snake(model.name)}_variables(Instance *instance) {{",
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
    """variables.c: the table itself."""
    return "\n".join(
        [
            _ORIGIN,
            '#include "kernel.h"',
            "",
            "#include <math.h>",
            "",
            f'const char MODEL_NAME[] = "{model.name}";',
            f'const char MODEL_FINGERPRINT[] = "{model.fingerprint}";',
            f"const size_t VARIABLE_COUNT = {len(model.variables)};",
            f"const size_t EXPOSED_COUNT = {len(model.exposed)};",
            "const VariableDefinition VARIABLES[] = {",
            *_rows(model),
            "};",
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


def _number(variable: VariableDefinition) -> str:
    return f"VARIABLE_{variable.name.upper()}"


def _limit(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else repr(value)


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).removeprefix("_")
