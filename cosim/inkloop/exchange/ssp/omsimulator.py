"""What OMSimulator needs in an .ssd beyond the standard: identifiers as names, and the master and its step size.

It takes names of systems and components only in the form of `IDENTIFIER`, and does not know what kind a system is
without its annotation (schema/oms.xsd of its sources). Other tools skip the annotation of a type that they do not know.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np

from inkloop.fmu_writer.description import add

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
TYPE = "org.openmodelica"
NAMESPACE = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
MASTER = "oms-ma"
"""Its master of fixed steps, which steps all components from the same outputs (Jacobi)."""
_TOLERANCE = "0.0001"  # of its solvers for algebraic loops, of which there are none; its schema asks for it


def identifier(text: str) -> str:
    """The text with `_` in place of all that an identifier cannot hold; `system_` before one that begins otherwise."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    return name if IDENTIFIER.fullmatch(name) else f"system_{name}".rstrip("_")


def refused(names: Iterable[str]) -> list[str]:
    """The names that it refuses."""
    return [name for name in names if not IDENTIFIER.fullmatch(name)]


def settings(step_s: float) -> ET.Element:
    """The annotations of a system: the master and its communication step [s]."""
    element = ET.Element("ssd:Annotations")
    annotation = add(element, "ssc:Annotation", type=TYPE)
    own = add(annotation, "oms:Annotations", **{"xmlns:oms": NAMESPACE})
    information = add(own, "oms:SimulationInformation")
    step = np.format_float_positional(step_s, trim="-")  # its type knows no exponent
    add(information, "oms:FixedStepMaster", description=MASTER, stepSize=step, relativeTolerance=_TOLERANCE)
    return element
