"""The volume of a droplet from whole prints, heights constrained to add up to it, and their least-squares fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.models.layer_deposition import CELLS_OF_HEIGHTS

SINGULAR = 1e-6  # ratio of smallest to largest information below which the patterns do not determine it (assumed)


@dataclass(frozen=True, eq=False)
class Freedom:
    """Free heights of an ink.

    chosen: (free,) their indices among all heights in order; all heights are offset (heights,) + basis (heights, free)
    @ the free ones.
    """

    chosen: NDArray[np.int64]
    offset: NDArray[np.float64]
    basis: NDArray[np.float64]

    @classmethod
    def of(cls, shape: tuple[int, ...], volumes: NDArray[np.float64] | None) -> Freedom:
        """Of heights (materials, 3, 6 or 10): all of them, or all but h1 where the volume of a material's droplet
        [m, height over one cell] is given, (materials,).
        """
        places, whole = np.arange(shape[0] * shape[1]), np.eye(shape[0] * shape[1])
        if volumes is None:
            return cls(places, np.zeros(places.size), whole)
        of_material, kind = np.divmod(places, shape[1])
        first = kind == 0
        cells = np.array(CELLS_OF_HEIGHTS)[kind]
        taken = np.where(first[:, None] & (of_material[:, None] == of_material), -cells, whole)
        return cls(places[~first], np.where(first, volumes[of_material], 0.0), taken[:, ~first])

    def heights(self, free: NDArray[np.float64]) -> NDArray[np.float64]:
        """All heights in order, from the free ones."""
        return np.asarray(self.offset + self.basis @ free)


def droplet_volumes(records: Sequence[PrintRecord], materials: int, reach: int) -> NDArray[np.float64]:
    """(materials,) volume of a droplet over the area of a cell [m], from the volume that whole scans show to be added.

    Least squares of the growth since the first scan, of cells within reach of a droplet, over the droplets since.
    Raises IdentificationError where ink may have left the grid, or no scan shows the whole of it.
    """
    droplets, growth = [], []
    for record in records:
        inside = np.zeros(record.shape, np.bool_)
        inside[reach:-reach, reach:-reach] = True
        if (record.pattern[:, ~inside] > 0).any():
            raise IdentificationError(
                f"{record.name}: droplets lie within {reach} cells of the edge of the grid, where ink may be lost, so "
                f"that the volume of a droplet is unknown; leave {reach} empty cells"
            )
        counts = [(record.pattern == 1 + material).sum(axis=(1, 2)).cumsum() for material in range(materials)]
        growths = (record.measured[1:] - record.measured[0])[:, ~record.untouched(reach)]
        added = growths.sum(axis=1)
        whole = np.isfinite(added)
        droplets.append(np.stack(counts, axis=1)[whole])
        growth.append(added[whole])
    counted = np.concatenate(droplets)
    if np.linalg.matrix_rank(counted) < materials:
        raise IdentificationError(
            "the volume of a droplet is unknown: it takes scans of all cells that droplets reach, one before the print "
            "and one after layers of each material"
        )
    return np.asarray(np.linalg.lstsq(counted, np.concatenate(growth), rcond=None)[0])


def improved_heights(
    sensitivity: NDArray[np.float64],
    weight: NDArray[np.float64],
    error: NDArray[np.float64],
    heights: NDArray[np.float64],
    freedom: Freedom,
) -> NDArray[np.float64]:
    """Heights of at least 0 [m] with the least weighted squares of errors, which change with them linearly.

    sensitivity: (heights, n) of the predictions; weight, error: (n,) [1/m^2], [m] at the present heights (materials, 3,
    6 or 10) [m]. Raises IdentificationError where the patterns do not determine one.
    """
    if error.size == 0:
        raise IdentificationError("no cell was measured after a layer whose surroundings had been measured before it")
    total, basis = float(weight.sum()), freedom.basis
    information = (sensitivity * weight) @ sensitivity.T / total
    reduced = basis.T @ information @ basis
    values, vectors = np.linalg.eigh(reduced)
    if values[0] < SINGULAR * values[-1]:
        undetermined = vectors[:, values < SINGULAR * values[-1]]
        mixed = freedom.chosen[(np.abs(undetermined) > 0.1).any(axis=1)]
        named = ", ".join(f"h{k % heights.shape[1] + 1} of material {'AB'[k // heights.shape[1]]}" for k in mixed)
        raise IdentificationError(
            f"the patterns do not separate {named} from the others; print single droplets, stripes and "
            "checkerboards, or random patterns too"
        )
    chosen = heights.ravel()[freedom.chosen]
    away = heights.ravel() - freedom.heights(chosen)  # distance from the first guess, which need not conserve
    free = chosen + np.linalg.solve(reduced, basis.T @ (information @ away + (sensitivity * weight) @ error / total))
    root = np.linalg.cholesky(reduced).T
    return freedom.heights(nnls(root, root @ free)[0]).reshape(heights.shape)
