"""One layer as bitmaps: separated by pass, ink and drop size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap
from inkloop.contract import pass_colour

INKS = "AB"
"""Letters of the materials 1 and 2 of a pattern."""


@dataclass(frozen=True, eq=False)
class Separation:
    """Sites (nx, ny) that one bitmap of a layer jets. number: of the pass in the order of jetting, from 1.

    colour: of the cells of the pass, see `contract.pass_colour`, None for all cells; drop: "", "d2" for the sites with
    drops of that size, "b1" for that bit of the level; drops: number of drops of a set pixel.
    """

    number: int
    colour: int | None
    ink: str
    drop: str
    drops: int
    sites: BoolMap

    @property
    def title(self) -> str:
        """Title of the bitmap, for a person."""
        return ", ".join(filter(None, (f"pass {self.number}", f"ink {self.ink}", self.drop)))

    def name(self, layer: int) -> str:
        """File name without suffix."""
        return "_".join(filter(None, (f"L{layer:04d}", f"P{self.number}", self.ink, self.drop)))


def separations(
    pattern: NDArray[np.integer],
    drop_level: NDArray[np.integer] | None,
    *,
    inks: int,
    levels: int,
    split: str | None,
    colours: tuple[int, ...],
) -> Iterator[Separation]:
    """Bitmaps of a layer, empty ones included: every layer has the same set.

    pattern: (nx, ny), 0 none, 1 A, 2 B; drop_level: (nx, ny) drops of each droplet, None for one; levels: their
    maximum; split: one of DROP_SPLITS, None for single drops; colours: in the order of jetting, none for one pass.
    """
    i, j = np.indices(pattern.shape)
    drops = np.ones_like(pattern) if drop_level is None else drop_level
    for number, colour in enumerate(colours or (None,), start=1):
        of_pass = np.ones(pattern.shape, np.bool_) if colour is None else pass_colour(i, j) == colour
        for ink in range(1, inks + 1):
            sites = (pattern == ink) & of_pass
            for name, worth, chosen in _by_drop(drops, levels, split):
                yield Separation(number, colour, INKS[ink - 1], name, worth, sites & chosen)


def _by_drop(
    drops: NDArray[np.integer], levels: int, split: str | None
) -> Iterator[tuple[str, int, NDArray[np.bool_]]]:
    if split == "bits":
        for bit in range(levels.bit_length()):
            yield f"b{bit}", 1 << bit, (drops >> bit) & 1 == 1
    elif split == "planes":
        for level in range(1, levels + 1):
            yield f"d{level}", level, drops == level
    else:
        yield "", 1, np.ones(drops.shape, np.bool_)
