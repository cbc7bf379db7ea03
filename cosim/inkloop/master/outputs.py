"""Outputs of a component, checked against its ports."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Port, Values
from inkloop.errors import ComponentError


def checked_output(port: Port, outputs: Values, must_be_finite: bool) -> NDArray[Any]:
    """Its value among `outputs`, read-only, in the declared shape and type. Raises ComponentError."""
    if port.name not in outputs:
        raise ComponentError(f"output {port.name} was declared but not returned")
    value = np.asarray(outputs[port.name])
    if value.shape != port.shape:
        raise ComponentError(f"output {port.name} has shape {value.shape}, declared {port.shape}")
    if value.dtype != port.dtype:
        if not np.can_cast(value.dtype, port.dtype, "same_kind"):
            raise ComponentError(f"output {port.name} is {value.dtype}, declared {port.dtype}")
        value = value.astype(port.dtype)
    if must_be_finite and not (np.isfinite(value).all() if value.shape else isfinite(value)):
        cell = tuple(int(i) for i in np.argwhere(~np.isfinite(value))[0])
        raise ComponentError(
            f"output {port.name} is {value[cell]} in cell {cell}" if cell else f"output {port.name} is {value}"
        )
    if value.flags.writeable:
        value = value.view()
        value.flags.writeable = False  # consumers share it
    return value
