"""Which devices and which simulated parts may stand in one loop."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from inkloop.component import Component, is_device, is_shadow
from inkloop.wiring import Connection


def mix_faults(components: Mapping[str, Component]) -> list[str]:
    """What is wrong with devices beside simulated parts, one sentence each; empty if they go together.

    A device that prints needs a device that scans and the other way round, or a shadow: a model that follows the
    commanded patterns.
    """
    if any(is_shadow(component) for component in components.values()):
        return []
    advice = 'add a component with kind = "Shadow", a model that follows the commanded patterns'
    faults = []
    for printer in _giving("layers_printed", components):
        for profiler in _giving("layers_scanned", components):
            if is_device(components[printer]) and not is_device(components[profiler]):
                faults.append(
                    f"{printer} is a device and {profiler} simulates a sensor, which has no surface to scan; {advice} "
                    f"and gives {profiler} its height, or make {profiler} a device"
                )
            elif is_device(components[profiler]) and not is_device(components[printer]):
                faults.append(
                    f"{profiler} is a device and {printer} simulates a printer, of which {profiler} sees nothing; "
                    f"{advice}, to be held against the scans, or make {printer} a device"
                )
    return faults


def shadow_faults(components: Mapping[str, Component], connections: Sequence[Connection]) -> list[str]:
    """A shadow that a sensor scans must not take those scans for the surface that it begins on."""
    faults = []
    fed = {connection.target_parts: connection.source_parts for connection in connections}
    for name, component in components.items():
        sensor, _ = fed.get((name, "layers_scanned"), ("", ""))
        scans_shadow = fed.get((sensor, "height")) == (name, "height")
        if is_shadow(component) and scans_shadow and getattr(component, "start", "job") != "job":
            faults.append(
                f'{name} begins on the first scan of {sensor}, which scans {name} itself; write start = "job" in '
                f"components.{name}, or let {sensor} scan a printer"
            )
    return faults


def _giving(output: str, components: Mapping[str, Component]) -> Iterable[str]:
    return [name for name, part in components.items() if any(port.name == output for port in part.outputs)]
