"""The square of 25 x 25 droplets and 10 layers that took the paper a quarter of an hour."""

from __future__ import annotations

from time import process_time
from typing import Literal

import numpy as np

from inkloop.component import FloatMap
from inkloop.units import UM_PER_M
from inkloop_lab.models import YoungLaplaceDeposition
from inkloop_lab.models.young_laplace_deposition import FineSurface
from inkloop_lab.reproduce import pictures
from inkloop_lab.reproduce.comparison import Part, Row

SIDE, MARGIN, LAYERS, PAPER_S = 25, 2, 10, 900.0
SHORT_OF_IT = (
    "200 µm is the thickness that the paper specifies; 30 pl every 42.3 µm are 16.8 µm per layer, 168 µm in ten; "
    "the inner square is higher because the lines contract and draw ink away from their ends"
)
ANOTHER_COMPUTER = "on one core of this computer; the paper used another"
NO_NUMBERS = "the paper shows the shape and gives no numbers for it"


def find(quick: bool) -> Part:
    """Shape numbers on two grids, linear and nonlinear, and the time."""
    rows, shown = [], {}
    for form in ("nonlinear", "linear"):
        for per_pitch in (6,) if quick else (8, 16):
            surface, seconds = printed(form, per_pitch)
            rows += _rows(f"Fig. 7 and 8, {form}, dx {surface.spacing * UM_PER_M:.2g} µm", surface, seconds)
            shown[form] = surface
    walls = {name: (end_wall(surface), side_wall(surface), surface.spacing) for name, surface in shown.items()}
    return Part(rows, {"square": pictures.square(shown["nonlinear"]), "square-walls": pictures.square_walls(walls)})


def printed(form: Literal["linear", "nonlinear"], per_pitch: int, layers: int = LAYERS) -> tuple[FineSurface, float]:
    """The square and the processor time that it took [s]."""
    model = YoungLaplaceDeposition(form=form, cells_per_pitch=per_pitch)
    full = np.pad(np.ones((SIDE, SIDE), dtype=np.int32), MARGIN)
    surface = model.start(np.zeros(full.shape))
    begin = process_time()
    for layer in range(layers):
        surface = model.layer(surface, full, layer + 1)
    return surface, process_time() - begin


def end_wall(surface: FineSurface) -> FloatMap:
    """Profile along the lines [µm], mean over the inner 15 of them."""
    fine, n = surface.over_grid, _per_pitch(surface)
    return np.asarray(fine[:, 7 * n : 22 * n].mean(axis=1)) * UM_PER_M


def side_wall(surface: FineSurface) -> FloatMap:
    """Profile across the lines [µm], mean over the inner 15 droplets of each."""
    fine, n = surface.over_grid, _per_pitch(surface)
    return np.asarray(fine[7 * n : 22 * n].mean(axis=0)) * UM_PER_M


def wall(profile: FloatMap, spacing_um: float) -> tuple[float, float]:
    """Width from 10 to 90 % of the highest [µm] and mean angle [degrees] of the wall where a profile begins."""
    half = profile[: len(profile) // 2]
    top, rising = half.max(), half[: half.argmax() + 1]
    low, high = (np.interp(share * top, rising, np.arange(len(rising)) * spacing_um) for share in (0.1, 0.9))
    return float(high - low), float(np.degrees(np.arctan2(0.8 * top, high - low)))


def corner(surface: FineSurface) -> float:
    """Mean height over the four corner droplets [µm]: at their sites."""
    fine, n = surface.over_grid, _per_pitch(surface)
    sites = [MARGIN * n + n // 2, (MARGIN + SIDE - 1) * n + n // 2]
    low = (n + 1) % 2  # an even number of points has its site between two
    return float(np.mean([fine[i - low : i + 1, j - low : j + 1].mean() for i in sites for j in sites])) * UM_PER_M


def outside(surface: FineSurface) -> float:
    """Share of the volume outside the nominal square."""
    fine, n = surface.over_grid, _per_pitch(surface)
    nominal = slice(MARGIN * n, (MARGIN + SIDE) * n)
    return 1.0 - float(fine[nominal, nominal].sum() / fine.sum())


def ridge(surface: FineSurface) -> float:
    """Highest of the inner droplets' sites, mean along the lines [µm]."""
    fine, n = surface.over_grid, _per_pitch(surface)
    sites = fine[n // 2 :: n, n // 2 :: n]
    return float(sites[7:22].mean(axis=0).max()) * UM_PER_M


def _rows(where: str, surface: FineSurface, seconds: float) -> list[Row]:
    spacing = surface.spacing * UM_PER_M
    (end_width, end_angle), (side_width, side_angle) = (
        wall(profile, spacing) for profile in (end_wall(surface), side_wall(surface))
    )
    inner = float(surface.height[7:22, 7:22].mean()) * UM_PER_M
    return [
        Row(where, "inner 15 x 15 droplets, mean", "µm", 200.0, inner, remark=SHORT_OF_IT),
        Row(where, "end walls, 10 to 90 %", "µm", None, end_width, remark=NO_NUMBERS),
        Row(where, "end walls, angle", "deg", None, end_angle),
        Row(where, "side walls, 10 to 90 %", "µm", None, side_width),
        Row(where, "side walls, angle", "deg", None, side_angle),
        Row(where, "ridge along the side walls", "µm", None, ridge(surface)),
        Row(where, "corner droplet", "µm", None, corner(surface)),
        Row(where, "volume outside the square", "%", None, 100.0 * outside(surface)),
        Row(where, "bodies solved linearly", "%", None, 100.0 * surface.fallbacks / (SIDE * LAYERS)),
        Row(where, "time", "s", PAPER_S, seconds, remark=ANOTHER_COMPUTER),
        Row(where, "times faster", "1", None, PAPER_S / seconds),
    ]


def _per_pitch(surface: FineSurface) -> int:
    return int(surface.over_grid.shape[0]) // int(surface.height.shape[0])
