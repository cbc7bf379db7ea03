"""A profiler that is not on the bus: its height maps are awaited as files in a folder, one per layer."""

from __future__ import annotations

import hashlib
import io
import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar
from zipfile import BadZipFile

import numpy as np

from inkloop.component import DEVICE_LOGGER, Job, Status, Values
from inkloop.contract import LAYERS_PRINTED, LAYERS_SCANNED, MEASURED_HEIGHT, STATUS, VALID, contract_ports
from inkloop.errors import ComponentError, HeightMapError
from inkloop.metrology import map_folder_options as options
from inkloop.metrology.folder_watch import FIELD, FolderWatch, Wait, name_errors
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import library_error, read
from inkloop.metrology.placement import Placement
from inkloop.metrology.registration import Registration, from_fiducials
from inkloop.units import M_PER_UM

PATIENCE_S = 0.2
"""Seconds that a step waits for a missing file: Ctrl-C ends a run between two steps."""
NEXT_WORD_S = 30.0
FIT_REACH_CELLS = 3
FIDUCIAL_SHARE = 0.1  # of the pitch that fiducials may be off by (assumed)

_LOG = logging.getLogger(f"{DEVICE_LOGGER}.map_folder")


class MapFolder:
    """Scans the newest printed layer by waiting for its file, and lays it over the grid.

    Each step waits a moment and leaves the loop running: `status` is busy until the file is there and complete, and the
    run ends with a message after `timeout_s` (wall clock). Options: see map_folder_options. Raises ValueError for
    inconsistent options, later ComponentError.
    """

    is_device: ClassVar[bool] = True

    def __init__(
        self,
        job: Job,
        *,
        folder: options.Folder,
        file_name: options.FileName = "layer_{layer:04d}.csv",
        unit: options.Unit = None,
        pixel_um: options.Pixel = None,
        count_scale: options.CountScale = None,
        invalid_value: options.InvalidValue = None,
        rows_along: options.RowsAlong = None,
        channel: options.Channel = None,
        registration: options.Registered = "given",
        offset_x_um: options.OffsetX = 0.0,
        offset_y_um: options.OffsetY = 0.0,
        rotation_deg: options.Rotation = 0.0,
        mirror: options.Mirrored = "none",
        fiducials_map_um: options.FiducialsOnMap = None,
        fiducials_grid_um: options.FiducialsOnGrid = None,
        residual_max_um: options.ResidualMax = None,
        fit_reach_um: options.FitReach = None,
        fit_reach_deg: options.FitReachAngle = 2.0,
        valid_share_min: options.ValidShareMin = 0.5,
        datum: options.Levelled = "none",
        datum_margin_cells: options.DatumMargin = 1,
        complete: options.Completion = "stable",
        settle_s: options.Settling = 0.5,
        timeout_s: options.Timeout = 600.0,
        replay: options.Replay = False,
    ) -> None:
        errors = name_errors("file_name", file_name, FIELD, "layer_{layer:04d}.csv")
        if reason := library_error(Path(file_name)):
            errors.append(f"file_name: {reason}")
        placed = Registration(offset_x_um * M_PER_UM, offset_y_um * M_PER_UM, math.radians(rotation_deg), mirror=mirror)
        if [fiducials_map_um is None, fiducials_grid_um is None] != [registration != "fiducials"] * 2:
            errors.append(
                "fiducials_map_um and fiducials_grid_um: give both with registration = 'fiducials', else none"
            )
        elif fiducials_map_um is not None and fiducials_grid_um is not None:
            limit = FIDUCIAL_SHARE * job.pitch if residual_max_um is None else residual_max_um * M_PER_UM
            on_map, on_grid = (np.array(points) * M_PER_UM for points in (fiducials_map_um, fiducials_grid_um))
            try:
                placed = from_fiducials(on_map, on_grid, mirror=mirror, residual_max=limit)
            except HeightMapError as error:
                errors.append(str(error))
        if errors:
            raise ValueError("; ".join(errors))
        reach = FIT_REACH_CELLS * job.pitch if fit_reach_um is None else fit_reach_um * M_PER_UM
        fit_reach = (reach, math.radians(fit_reach_deg)) if registration == "fit" else None
        self._placement = Placement(job, placed, valid_share_min, fit_reach, datum, datum_margin_cells)
        self._watch = FolderWatch(Path(folder), file_name, complete, settle_s)
        self._reading: Mapping[str, Any] = {
            "unit": unit,
            "pixel": None if pixel_um is None else pixel_um * M_PER_UM,
            "scale": count_scale,
            "invalid_value": invalid_value,
            "rows_along": rows_along,
            "channel": channel,
        }
        self._timeout_s, self._replay = timeout_s, replay
        shape = (job.nx, job.ny)
        self.inputs = contract_ports(shape, LAYERS_PRINTED)
        self.outputs = contract_ports(shape, MEASURED_HEIGHT, VALID, LAYERS_SCANNED, STATUS)
        self._height, self._valid = np.zeros(shape), np.zeros(shape, np.bool_)
        self._scanned, self._status = -1, Status.IDLE
        self._map_shape: tuple[int, ...] = ()
        self._digest = b""
        self._looked = False
        self._wait: Wait | None = None

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Nothing is scanned yet. Raises ComponentError if the folder is not there."""
        if not self._watch.folder.is_dir():
            raise ComponentError(
                f"{self._watch.folder.resolve()} is no folder; make it, let the profiler write there, or correct folder"
            )
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Look for the file of the newest layer if it is not scanned yet. Raises ComponentError."""
        layer = int(inputs[LAYERS_PRINTED])
        if not self._looked:
            self._refuse_leftovers(layer)
            self._looked = True
        if layer > self._scanned:
            self._status = Status.BUSY
            path = self._awaited(layer)
            if path is not None:
                self._scan(path, layer)
        return self._outputs()

    def terminate(self) -> None:
        """Nothing to release."""

    def save(self) -> bytes:
        """The last scan."""
        buffer = io.BytesIO()
        np.savez(
            buffer,
            height=self._height,
            valid=self._valid,
            scanned=self._scanned,
            map_shape=np.array(self._map_shape, np.int64),
            digest=np.frombuffer(self._digest, np.uint8),
        )
        return buffer.getvalue()

    def restore(self, saved: bytes) -> None:
        """Continue after the scan of a saved state. Raises ComponentError if it is none of this grid."""
        try:
            with np.load(io.BytesIO(saved), allow_pickle=False) as stored:
                height, valid = stored["height"], stored["valid"]
                scanned, digest = int(stored["scanned"]), stored["digest"].tobytes()
                map_shape = tuple(int(count) for count in stored["map_shape"])
        except (ValueError, KeyError, OSError, BadZipFile) as error:
            raise ComponentError(f"what is to be restored is no state of a map folder ({error})") from error
        if height.shape != self._height.shape:
            raise ComponentError(
                f"the state to be restored has {height.shape} cells; this grid has {self._height.shape}"
            )
        self._height, self._valid, self._scanned, self._digest = height, valid, scanned, digest
        self._map_shape, self._status, self._wait, self._looked = map_shape, Status.IDLE, None, False

    def _refuse_leftovers(self, layer: int) -> None:
        """Raises ComponentError for files of layers not yet printed: they belong to another print."""
        later = sorted(number for number in self._watch.layers() if number > layer)
        if later and not self._replay:
            raise ComponentError(
                f"{self._watch.path(later[0])} is there before layer {later[0]} is printed, left by an earlier print "
                f"({len(later)} such files); move them away or name another folder; recorded maps: replay = true"
            )

    def _awaited(self, layer: int) -> Path | None:
        """The complete file of a layer, None while it is awaited. Raises ComponentError after the time limit."""
        if self._wait is None or self._wait.layer != layer:
            self._wait = Wait(layer, self._watch.clock())
        try:
            path = self._watch.look(layer, PATIENCE_S)
        except OSError as error:
            raise ComponentError(f"{self._watch.folder}: cannot be read: {error.strerror or error}") from error
        waited = self._watch.clock() - self._wait.since
        if path is not None:
            return path
        if waited > self._timeout_s:
            raise ComponentError(self._too_late(layer))
        if waited >= self._wait.next_word_s:
            self._wait.next_word_s += NEXT_WORD_S
            expected = self._watch.path(layer)
            text = "layer %d is printed: waiting for %s since %.0f s (up to %.0f s)"
            _LOG.info(text, layer, expected, waited, self._timeout_s)
        return None

    def _too_late(self, layer: int) -> str:
        path, known = self._watch.path(layer), self._watch.layers()
        if self._watch.is_in_sight(layer):
            return (
                f"{path} was not complete within {self._timeout_s:g} s: it keeps changing, is empty, or its .done mark "
                "is missing; check what writes it and the option complete"
            )
        newest = f"the newest there is {known[max(known)].name}" if known else "there is no file of any layer"
        return (
            f"{path} did not come within {self._timeout_s:g} s; {newest}: scan layer {layer} and save it under that "
            "name, or correct folder, file_name or timeout_s"
        )

    def _scan(self, path: Path, layer: int) -> None:
        try:
            map_ = read(path, **self._reading)
            digest = self._checked(map_)
            placed = self._placement.place(map_, layer)
        except HeightMapError as error:
            raise ComponentError(f"layer {layer}: {error}") from error
        self._height = np.where(placed.valid, placed.height, self._height)
        self._valid, self._scanned, self._status = placed.valid, layer, Status.IDLE
        self._map_shape, self._digest, self._wait = map_.shape, digest, None
        _LOG.info("layer %d: %s", layer, f"{path.name}: {map_}; {placed.words}")

    def _checked(self, map_: HeightMap) -> bytes:
        """Fingerprint of a map, which must differ from the last one and have its size. Raises HeightMapError."""
        digest = hashlib.sha256(map_.z.tobytes()).digest()
        if digest == self._digest and not self._replay:
            raise HeightMapError(
                f"{map_.source}: holds the heights of the scan of layer {self._scanned} again; scan again and save that"
            )
        if self._map_shape not in ((), map_.shape):
            m, n = self._map_shape
            raise HeightMapError(
                f"{map_.source}: has {map_.shape[0]} x {map_.shape[1]} pixels, the scans before it {m} x {n}; scan "
                "the same field again: another one lies elsewhere on the grid"
            )
        return digest

    def _outputs(self) -> Values:
        return {
            MEASURED_HEIGHT: self._height.copy(),
            VALID: self._valid.copy(),
            LAYERS_SCANNED: np.asarray(self._scanned, np.int32),
            STATUS: np.asarray(int(self._status), np.int32),
        }
