"""A deposition model that follows the commanded patterns and detects when the rig deviates."""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, Component, FloatMap, Job, Port, Status, Values
from inkloop.components.followed_plant import FollowedPlant
from inkloop.contract import (
    HEIGHT,
    LAYER_COMMAND,
    LAYER_UNKNOWN,
    LAYERS_COMPARED,
    LAYERS_FOLLOWED,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    MEASURED_HEIGHT,
    STATUS,
    VALID,
    contract_ports,
)
from inkloop.errors import ComponentError
from inkloop.units import UM_PER_M

_LOG = logging.getLogger(__name__)
_SAME_M = 1e-9  # a plant on another start surface than it was given differs by more (assumed)

SCAN_INPUTS = (MEASURED_HEIGHT, VALID, LAYERS_SCANNED)


@dataclass(frozen=True)
class Divergence:
    """Root mean squares over the part [m]; NaN where no cell can be compared.

    growth: of the height added since the scan before, over cells seen in both; surface: of the heights, over cells
    seen. Growth distinguishes a device that fails from one that is slightly off in every layer, and needs no datum.
    """

    growth: float = math.nan
    surface: float = math.nan


@dataclass(frozen=True, eq=False)
class ScannedLayer:
    """One layer as measured and as the model has it: (nx, ny) heights [m], `valid` the cells that were measured."""

    measured: FloatMap
    valid: BoolMap
    surface: FloatMap

    def divergence(self, before: ScannedLayer | None, mask: BoolMap) -> Divergence:
        """Against the scan before it (None: there is none), over the cells of `mask` (nx, ny)."""
        error, seen = self.measured - self.surface, self.valid & mask
        if before is None:
            return Divergence(surface=_rms(error[seen]))
        both = seen & before.valid
        return Divergence(_rms((error - (before.measured - before.surface))[both]), _rms(error[seen]))


class Shadow:
    """Deposits a layer on its plant when the printer reports that it is done, with the pattern it was commanded with.

    make_plant: see `FollowedPlant`. start: "scan": the scan of layer 0 is the surface to begin on; "job": that of the
    job, where no real surface is scanned. alarm, stop: growth divergence [m] (see `Divergence`) above which the status
    is untrusted, or a fault that ends the run (None: never). Raises ValueError for a plant that does not fit, later
    ComponentError.

    A layer that its printer calls unknown cannot be compared: the model continues from its scan.

    Outputs besides the surface and both divergences: `layers_followed`, the layer of `height`; `layers_compared`, the
    layer of the scan that the divergences belong to, -1 before the first.
    """

    is_shadow = True
    optional_inputs = frozenset(SCAN_INPUTS)

    def __init__(
        self,
        job: Job,
        make_plant: Callable[[Job], Component],
        *,
        start: Literal["scan", "job"] = "scan",
        alarm: float = 3e-6,
        stop: float | None = None,
    ) -> None:
        self.starts_on_scan = start == "scan"
        self._mask, self._alarm, self._stop = job.mask, alarm, math.inf if stop is None else stop
        self._plant = FollowedPlant(job, make_plant)
        self.inputs, self.outputs = shadow_ports(self._plant.inputs, (job.nx, job.ny))
        self._reference, self._compared, self._unknown = 0, -1, -1
        self._last_scan: ScannedLayer | None = None
        self._divergence, self._status = Divergence(), Status.IDLE

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Begin on the surface of the job; commands count from the present one."""
        self._reference = int(inputs[LAYER_COMMAND])
        self._plant.begin(self._reference)
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Take a new command, deposit what has been printed, compare what has been scanned. Raises ComponentError."""
        if bool(inputs.get(LAYER_UNKNOWN, False)):
            self._unknown = int(inputs[LAYERS_PRINTED])
        self._look(inputs)  # a scan of layer 0 is the start surface, so it comes before the layer that waited for it
        self._plant.take_command(inputs)
        self._plant.follow(int(inputs[LAYERS_PRINTED]), step_ns)
        self._look(inputs)
        return self._outputs()

    def terminate(self) -> None:
        """Terminate the plant."""
        self._plant.terminate()

    def save(self) -> bytes:
        """The last comparison, surfaces and patterns not yet used, the plant's own state. Raises ComponentError."""
        state: dict[str, NDArray[Any]] = {
            "compared": np.array([self._reference, self._compared, self._unknown, self._status], np.int64),
            "divergence": np.array([self._divergence.growth, self._divergence.surface]),
            **self._plant.state(),
        }
        if self._last_scan is not None:
            state |= {f"scan/{name}": value for name, value in vars(self._last_scan).items()}
        buffer = io.BytesIO()
        np.savez(buffer, **state)  # type: ignore[arg-type]
        return buffer.getvalue()

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state. Raises ComponentError if it is none, or the plant refuses it."""
        try:
            with np.load(io.BytesIO(saved), allow_pickle=False) as stored:
                state = {key: stored[key] for key in stored.files}
            self._plant.restore(state)
            self._reference, self._compared, self._unknown, status = (int(count) for count in state["compared"])
            self._divergence = Divergence(*(float(value) for value in state["divergence"]))
            self._status = Status(status)
            scan = {key.removeprefix("scan/"): value for key, value in state.items() if key.startswith("scan/")}
            self._last_scan = ScannedLayer(**scan) if scan else None
        except (ValueError, KeyError, TypeError, OSError, BadZipFile) as error:
            raise ComponentError(f"what is to be restored is no state of a shadow ({error})") from error

    def _look(self, inputs: Values) -> None:
        """Compare a scan that is new and of a layer that has been followed."""
        if LAYERS_SCANNED not in inputs:
            self._plant.forget_before(self._plant.layer)
            return
        scanned = int(inputs[LAYERS_SCANNED])
        if scanned > self._compared and scanned in self._plant.surfaces:
            self._compare(scanned, np.array(inputs[MEASURED_HEIGHT], np.float64), np.array(inputs[VALID], np.bool_))

    def _compare(self, layer: int, measured: FloatMap, valid: BoolMap) -> None:
        plant = self._plant
        if plant.layer == layer == self._reference and self.starts_on_scan:
            plant.begin_on(start_surface(plant.start_surface, measured, valid))
            if not np.allclose(plant.surfaces[layer], plant.start_surface, rtol=0.0, atol=_SAME_M):
                _LOG.warning(
                    "the plant takes no start surface (height_start); it begins on its own, and the surface "
                    "divergence holds what the real one is off by"
                )
        if layer == self._unknown:
            _LOG.warning("layer %d was aborted: the model continues from its scan", layer)
            if layer == plant.layer:
                plant.begin_on(start_surface(plant.surfaces[layer], measured, valid))
        scan = ScannedLayer(measured, valid, plant.surfaces[layer])
        if layer == self._unknown:
            self._divergence, self._status = Divergence(), Status.UNTRUSTED
        else:
            self._divergence = scan.divergence(self._last_scan, self._mask)
            self._status = self._judged(layer) if self._last_scan is not None else Status.IDLE
        self._last_scan, self._compared = scan, layer
        plant.forget_before(layer)

    def _judged(self, layer: int) -> Status:
        """The status after the scan of a layer; an alarm is logged."""
        growth = self._divergence.growth
        if math.isnan(growth):
            _LOG.warning(
                "layer %d: no cell of the part was seen in its scan and in the one before; nothing can be "
                "compared with the model",
                layer,
            )
            return Status.UNTRUSTED
        message = f"layer {layer} grew differently from the model, by {growth * UM_PER_M:.2f} µm rms over the part"
        if growth > self._stop:
            _LOG.error(
                "%s; more than stop_um = %g: the run ends. Look at the part and at the print head",
                message,
                self._stop * UM_PER_M,
            )
            return Status.FAULT
        if growth > self._alarm:
            _LOG.warning(
                "%s; more than alarm_um = %g. Look at the print head and at the scan", message, self._alarm * UM_PER_M
            )
            return Status.UNTRUSTED
        return Status.IDLE

    def _outputs(self) -> Values:
        return {
            HEIGHT: self._plant.surfaces[self._plant.layer].copy(),
            "growth_divergence": np.asarray(self._divergence.growth),
            "surface_divergence": np.asarray(self._divergence.surface),
            LAYERS_FOLLOWED: np.asarray(self._plant.layer, np.int32),
            LAYERS_COMPARED: np.asarray(self._compared, np.int32),
            STATUS: np.asarray(int(self._status), np.int32),
        }


def shadow_ports(plant_inputs: tuple[Port, ...], shape: tuple[int, int]) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
    """Inputs and outputs of a shadow, whose inputs begin with those of its plant."""
    inputs = (
        *plant_inputs,
        *contract_ports(shape, LAYERS_PRINTED, *SCAN_INPUTS, LAYER_UNKNOWN),
    )
    outputs = (
        *contract_ports(shape, HEIGHT),
        Port("growth_divergence", "m", start=math.nan),
        Port("surface_divergence", "m", start=math.nan),
        Port(LAYERS_FOLLOWED, dtype="int32"),
        Port(LAYERS_COMPARED, dtype="int32", start=-1.0),
        *contract_ports(shape, STATUS),
    )
    return inputs, outputs


def start_surface(assumed: FloatMap, measured: FloatMap, valid: BoolMap) -> FloatMap:
    """The start surface: the scan of layer 0, and on cells that it did not see `assumed`, raised by the median
    of their differences.

    All (nx, ny), heights [m]; `assumed` itself where no cell was seen.
    """
    if not valid.any():
        return assumed
    offset = float(np.median((measured - assumed)[valid]))
    return np.where(valid, measured, assumed + offset)


def _rms(differences: FloatMap) -> float:
    return float(np.sqrt(np.square(differences).mean())) if differences.size else math.nan
