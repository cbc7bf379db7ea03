"""A MATLAB script that builds the system in Simulink from FMU blocks: lines by the hundred that nobody draws.

Generated, not tried: no Simulink was at hand. What it takes into account is told by people who had one: an FMU is
found by its bare name on the MATLAB path; names like `height[1,1]` become buses unless the mapping is flat; an input
left open is 0, whatever the FMU starts with; what reaches no root output may be optimised away.
https://www.mathworks.com/help/simulink/ref_extras/fmu.html
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from inkloop import __version__
from inkloop.ssp.system import Part, System, Wire

_BLOCK = "simulink_extras/FMU Import/FMU"
_DATA_TYPES = {"Real": "double", "Integer": "int32", "Boolean": "boolean", "Enumeration": "int32"}


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
    yield "addpath(here);  % the block finds FMUs on the path only"
    yield "load_system('simulink_extras');"
    yield "if bdIsLoaded(model), close_system(model, 0); end  % of an earlier run of this script"
    yield "new_system(model);"
    yield f"set_param(model, 'SolverType', 'Fixed-step', 'FixedStep', '{system.step_s!r}');"
    yield f"set_param(model, 'StopTime', '{system.stop_s!r}');"
    for number, part in enumerate(system.parts):
        yield ""
        yield from _block(part, 300 * number + 50, system.step_s)
    for wire in system.wires:
        yield ""
        yield from _wire(system, wire)
    for part in system.parts:
        yield from _start_values(system, part)
        yield from _root_outputs(system, part)
    yield ""
    yield "save_system(model, fullfile(here, [model '.slx']));"


def _block(part: Part, left: int, step_s: float) -> Iterator[str]:
    yield f"block = [model '/{part.name}'];"
    yield f"add_block('{_BLOCK}', block, 'Position', [{left} 50 {left + 200} 650]);"
    yield f"set_param(block, 'FMUName', '{part.name}.fmu');"
    yield "set_param(block, 'FMUInputMapping', 'Flat', 'FMUOutputMapping', 'Flat');  % one port for each scalar"
    yield f"set_param(block, 'FMUSampleTime', '{step_s!r}');"
    inputs, outputs = (
        sum(len(part.scalars(each.name)) for each in part.description.variables.values() if each.causality == way)
        for way in ("input", "output")
    )
    yield "ports = get_param(block, 'PortHandles');"
    yield f"assert(numel(ports.Inport) == {inputs} && numel(ports.Outport) == {outputs}, ..."
    yield f"    '{part.name} has %d inputs and %d outputs; {inputs} and {outputs} were expected', ..."
    yield "    numel(ports.Inport), numel(ports.Outport));"


def _wire(system: System, wire: Wire) -> Iterator[str]:
    (source, output), (target, port) = wire.source, wire.target
    if not (source and target):
        yield f"% left open: {source or 'outside'}.{output} to {target or 'outside'}.{port}"
        return
    first = _position(system.part(source), output), _position(system.part(target), port)
    if not wire.transfer.is_plain:
        yield f"% not drawn, because values change on the way (times {wire.transfer.factor!r}, then plus "
        yield f"% {wire.transfer.offset!r}): {source}.{output} to {target}.{port}; put Gain and Bias blocks between"
        return
    yield f"for k = 0:{len(system.part(source).scalars(output)) - 1}  % {source}.{output} to {target}.{port}"
    yield f"    add_line(model, sprintf('{source}/%d', {first[0]} + k), sprintf('{target}/%d', {first[1]} + k));"
    yield "end"


def _start_values(system: System, part: Part) -> Iterator[str]:
    """Constant blocks with the start values of inputs that no wire feeds."""
    fed = {wire.target for wire in system.wires}
    for variable in part.description.variables.values():
        if variable.causality != "input" or (part.name, variable.name) in fed:
            continue
        count = len(part.scalars(variable.name))
        starts = [{"false": "0", "true": "1"}.get(text, text) for text in variable.start or ("0",)]
        first, name = _position(part, variable.name), f"{part.name}_{variable.name}"
        yield ""
        yield f"starts = [{' '.join(starts)}]{f' * ones(1, {count})' if len(starts) < count else ''};"
        yield f"for k = 0:{count - 1}  % {part.name}.{variable.name} keeps its start value"
        yield f"    name = sprintf('{name}_%d', k);"
        yield "    add_block('simulink/Sources/Constant', [model '/' name], ..."
        yield f"        'Value', num2str(starts(k + 1), 17), 'OutDataTypeStr', '{_DATA_TYPES[variable.type]}');"
        yield f"    add_line(model, [name '/1'], sprintf('{part.name}/%d', {first} + k));"
        yield "end"


def _root_outputs(system: System, part: Part) -> Iterator[str]:
    """Outputs of the model for the counters, means and states that no wire takes; maps stay inside."""
    taken = {wire.source for wire in system.wires}
    places = [
        f"'{part.name}_{variable.name}', {_position(part, variable.name)}"
        for variable in part.description.variables.values()
        if variable.causality == "output"
        and part.scalars(variable.name) == (variable.name,)
        and (part.name, variable.name) not in taken
    ]
    if places:
        yield ""
        yield f"outputs = {{{'; '.join(places)}}};"
        yield "for k = 1:size(outputs, 1)"
        yield "    add_block('simulink/Sinks/Out1', [model '/' outputs{k, 1}]);"
        yield f"    add_line(model, sprintf('{part.name}/%d', outputs{{k, 2}}), [outputs{{k, 1}} '/1']);"
        yield "end"


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
