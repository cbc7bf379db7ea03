"""Options of the controller in Python that the controller FMU does not have, each with what to do instead."""

from __future__ import annotations

from collections.abc import Mapping

INSTEAD: Mapping[str, str] = {
    "sweeps": "write sweeps_max",
    "dead_nozzles": "mark the cells that nozzles reach in jettable",
    "nozzle_pitch": "mark the cells that nozzles reach in jettable",
    "threads": "it plans on one thread; leave it out",
    "relaxation": "it relaxes by projected gradients; leave it out, or take kind 'LayerMpc'",
    "certified": "it proves no bound; take kind 'LayerMpc' for one",
}


def of_fmu(options: Mapping[str, object]) -> dict[str, object]:
    """The options of LayerMpc by the names that LayerController has for them: its output is called sweeps."""
    return {"sweeps_max" if key == "sweeps" else key: value for key, value in options.items()}


def split(options: Mapping[str, object]) -> tuple[dict[str, object], list[str]]:
    """The options that are left for the FMU, and what is wrong with the others."""
    faults = [f"{key} is no option of LayerController; {INSTEAD[key]}" for key in options if key in INSTEAD]
    left = {key: value for key, value in options.items() if key not in INSTEAD}
    if isinstance(left.get("alpha"), list):
        del left["alpha"]
        faults.append(
            "alpha is a schedule; LayerController takes one number: take kind 'LayerMpc' for a schedule, or a master "
            "that sets alpha between steps"
        )
    return left, faults
