"""The orientation of maps of others: axes that count the other way, or come in the other order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeAlias

from numpy.typing import NDArray
from pydantic import Field

Mirrored: TypeAlias = Annotated[
    Literal["none", "x", "y", "xy"], Field(description="axes that count the other way there")
]
Transposed: TypeAlias = Annotated[bool, Field(description="whether the first index there goes along y")]


@dataclass(frozen=True)
class Orientation:
    """From maps (nx, ny), i along x and j along y, to those of another program: mirrored, then transposed."""

    mirror: Mirrored = "none"
    transpose: Transposed = False

    @property
    def is_own(self) -> bool:
        """Whether maps are the same there."""
        return self.mirror == "none" and not self.transpose

    def shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """The shape of a map there."""
        return shape[::-1] if self.transpose else shape

    def there(self, own: NDArray[Any]) -> NDArray[Any]:
        """A map (nx, ny) as the other program counts it."""
        mirrored = own if self.is_own else self._mirrored(own)
        return mirrored.T if self.transpose else mirrored

    def here(self, other: NDArray[Any]) -> NDArray[Any]:
        """The map (nx, ny) of one from there."""
        own = other.T if self.transpose else other
        return own if self.is_own else self._mirrored(own)

    def _mirrored(self, own: NDArray[Any]) -> NDArray[Any]:
        return own[:: -1 if "x" in self.mirror else 1, :: -1 if "y" in self.mirror else 1]


OWN = Orientation()
