"""A MATLAB script that builds the system in Simulink from FMU blocks: lines by the hundred that nobody draws.

Generated, not tried: no Simulink was at hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from inkloop import __version__
from inkloop.ssp.system import Part, System

_BLOCK = "simulink_extras/FMU Import/FMU"


def script(system: System, model: str) -> str:
    """The script; the FMUs stand beside it and begin with the parameters of the system."""
    return "\n".join(_lines(system, model_name(model))) + "\n"


def model_name(text: str) -> str:
    """A name that MATLAB takes."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return name if name[:1].isalpha() else f"system_{name}"


def _lines(system: System, model: str) -> Iterator[str]:
    yield f"% {system.name}"
    yield f"% Made by inkloop {__version__}: builds {model}.slx from the FMUs beside it. Not tried by its makers."
    yield from (f"% {note}" for note in system.notes())
    yield f"model = '{model}';"
    yield "here = fileparts(mfilename('fullpath'));"
    yield "load_system('simulink_extras');"
    yield "new_system(model);"
    yield f"set_param(model, 'SolverType', 'Fixed-step', 'FixedStep', '{system.step_s!r}');"
    yield f"set_param(model, 'StopTime', '{system.stop_s!r}');"
    for number, part in enumerate(system.parts):
        yield ""
        yield f"block = [model '/{part.name}'];"
        yield f"add_block('{_BLOCK}', block, 'Position', [{300 * number + 50} 50 {300 * number + 250} 650]);"
        yield f"set_param(block, 'FMUName', fullfile(here, '{part.name}.fmu'));"
        yield f"set_param(block, 'FMUSampleTime', '{system.step_s!r}');"
    for wire in system.wires:
        yield ""
        (source, output), (target, port) = wire.source, wire.target
        if not (source and target):
            yield f"% left open: {source or 'outside'}.{output} to {target or 'outside'}.{port}"
            continue
        first = _position(system.part(source), output), _position(system.part(target), port)
        if not wire.transfer.is_plain:
            yield f"% not drawn, because values change on the way (times {wire.transfer.factor!r}, then plus "
            yield f"% {wire.transfer.offset!r}): {source}.{output} to {target}.{port}; put Gain and Bias blocks between"
            continue
        yield f"for k = 0:{len(system.part(source).scalars(output)) - 1}  % {source}.{output} to {target}.{port}"
        yield f"    add_line(model, sprintf('{source}/%d', {first[0]} + k), sprintf('{target}/%d', {first[1]} + k));"
        yield "end"
    yield ""
    yield "save_system(model, fullfile(here, [model '.slx']));"


def _position(part: Part, port: str) -> int:
    """The number of a port of the block, or of its first: inputs and outputs count by themselves, scalar by scalar."""
    number = 1
    causality = part.variable(port).causality
    for variable in part.description.variables.values():
        if variable.name == port:
            break
        if variable.causality == causality:
            number += len(part.scalars(variable.name))
    return number
