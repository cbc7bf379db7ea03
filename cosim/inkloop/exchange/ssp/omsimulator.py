"""Requirements of OMSimulator on an .ssd beyond the standard: identifiers as names, and the master and its step size.

Names of systems and components must match `IDENTIFIER`, and a system needs an annotation with its kind (schema/oms.xsd
of its sources). Other tools skip annotations of unknown types.
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
_TOLERANCE = "0.0001"  # of the solvers for algebraic loops, of which there are none; required by the schema


def identifier(text: str) -> str:
    """The text with `_` in place of each character that an identifier cannot hold; `system_` before one that begins
    otherwise.
    """
    name = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    return name if IDENTIFIER.fullmatch(name) else f"system_{name}".rstrip("_")


def refused(names: Iterable[str]) -> list[str]:
    """The names that OMSimulator rejects."""
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
