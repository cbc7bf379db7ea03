"""Whole prints with the errors of real scans and on other plants: what the closed loop reaches, and must reach."""

from __future__ import annotations

from dataclasses import replace
from math import nan

from rich.table import Table

from benchmarks.prints import (
    FLIPS,
    OPEN_LOOP,
    OURS,
    PAPERS,
    SCENARIOS,
    Case,
    Figure,
    Metrics,
    Wanted,
    column,
    figures,
    printed,
    table,
)
from inkloop_lab.score import board

PITCH_UM = 263.256
IN_CELLS = ("shift_x", "shift_y", "shift_std", "spot_radius")
WITH_OPEN_LOOP = (OURS, OPEN_LOOP)
COMPARED = (OURS, FLIPS, PAPERS, OPEN_LOOP)
CYLINDER, CYLINDER_40, R10 = (SCENARIOS / f"{name}.toml" for name in ("cylinder", "cylinder-40", "misaligned-scan"))
LASER = {"components.profiler.preset": "laser"}
VARIATION = {"components.printer.variation": 0.2, "components.printer.variation_kind": "per_droplet"}
TEN_HIGH = {"part.height_um": 70.751}  # 10 drops over a cell
TOLERANCE_UM = 0.05  # by which a shift may show in the part, as an aim
NO_CELL_ABOVE = {"components.controller.overshoot_limit_um": 0.0}
LOSS_UM = 0.01  # by which looking for a shift may make prints with an exact sensor worse


def flat(mae: tuple[float, float], std: tuple[float, float], bias: str, printed_std: str) -> tuple[Wanted, ...]:
    """(must, aim) of mean absolute error and standard deviation [um], and what the paper prints."""
    return (Wanted("mean_error", printed=bias), Wanted("mae", *mae), Wanted("std", *std, printed=printed_std))


def bounded(mae: float, mae_aim: float, highest: float, highest_aim: float) -> tuple[Wanted, ...]:
    """Mean absolute error, and how far above the target the highest cell of all prints may be [um]."""
    return (Wanted("mae", mae, mae_aim), Wanted("std"), Wanted("highest", highest, highest_aim, worst=True))


def r10(name: str, wanted: tuple[Wanted, ...], **sensor: float) -> Case:
    """The cylinder of radius 10 cells, 150 um high, measured by a sensor with these errors alone; lengths in cells."""
    lengths = {f"{error}_um": sensor.pop(error, 0.0) * PITCH_UM for error in IN_CELLS}
    options = {f"components.profiler.{key}": value for key, value in {**lengths, **sensor}.items()}
    return Case(f"R10, {name}", R10, wanted, options)


CYLINDERS = (
    Case("cylinder, 20 %", CYLINDER,
         (*flat((0.30, 0.24), (0.39, 0.31), "0.7", "4.1"), Wanted("layers", 73, 66)), planners=COMPARED),
    Case("cylinder, 40 %", CYLINDER_40,
         (*flat((0.52, 0.40), (0.64, 0.50), "1.9", "4.5"), Wanted("layers", 82, 74)), planners=WITH_OPEN_LOOP),
    Case("20 %, sensor 1 um + 0.1 um, ink unknown", CYLINDER, flat((0.50, 0.48), (0.44, 0.36), "-", "-"), LASER),
    Case("40 %, the same sensor", CYLINDER_40, flat((0.66, 0.62), (0.68, 0.55), "-", "-"), LASER),
)  # fmt: skip
IN_REGISTER = replace(
    r10("sensor in register", (Wanted("mae"), Wanted("std"), Wanted("highest", worst=True), Wanted("layers"))),
    planners=WITH_OPEN_LOOP,
)
AS_THEY_ARE = replace(
    r10("sensor in register, scans taken as they are", (Wanted("mae"),)),
    overrides={**IN_REGISTER.overrides, "components.controller.register_scans": False},
)
SHIFTED = tuple(
    r10(
        f"shift {cells} cells in {axes}",
        (*bounded(must, nan, 5.0, nan), Wanted("shift_error", 0.05, 0.02, worst=True)),
        **{f"shift_{axis}": cells for axis in axes.split(" and ")},
    )
    for cells, must in ((0.1, 0.5), (0.25, 0.8), (0.5, 1.2), (1.0, 2.0))
    for axes in ("x", "y", "x and y")
)
"""Their aims are the figures of `IN_REGISTER` and a tolerance."""
SCANS = (
    r10("shift that scatters by 0.1 cells", bounded(0.6, 0.4, 5.0, 2.0), shift_std=0.1),
    r10("spot 0.5 cells", bounded(0.8, 0.5, 5.0, 2.0), spot_radius=0.5),
    r10("spot 1 cell", bounded(1.5, 0.5, 5.0, 2.0), spot_radius=1.0),
    r10("shift 0.25, spot 0.5 cells, noise 1 um, 10 % drop-out", bounded(1.2, 0.8, 8.0, 5.0),
        shift_x=0.25, spot_radius=0.5, noise_std_um=1.0, dropout_rate=0.1),
    r10("offset +5 um, in scan 0 too", (Wanted("mae"), Wanted("std"), Wanted("untrusted")), bias_um=5.0),
)  # fmt: skip
PLANTS = (
    Case("Young-Laplace, score board", board.FOLDER / "plant-v1" / "young-laplace.toml",
         (Wanted("rms", 3.5, 3.0), Wanted("highest", worst=True)), planners=WITH_OPEN_LOOP),
    Case("Young-Laplace, 20 %", SCENARIOS / "surface-tension.toml",
         (Wanted("mae"), Wanted("highest", 18.0, 14.0, worst=True)), VARIATION, planners=WITH_OPEN_LOOP),
    Case("Young-Laplace, 20 %, overshoot limited to 0", SCENARIOS / "surface-tension.toml",
         (Wanted("mae"), Wanted("highest", 18.0, 14.0, worst=True)), {**VARIATION, **NO_CELL_ABOVE}),
    Case("Wu-Chiu, 10 droplets high", SCENARIOS / "wu-chiu-plant.toml",
         (Wanted("mae"), Wanted("highest", 15.0, 8.0, worst=True)), TEN_HIGH, planners=WITH_OPEN_LOOP),
)  # fmt: skip
CASES = (*CYLINDERS, IN_REGISTER, AS_THEY_ARE, *SHIFTED, *SCANS, *PLANTS)


def measure(seeds: int) -> Table:
    """Figures over at most so many seeds, with their targets; "highest" and "shift" are the worst of the seeds."""
    return table("whole prints in closed loop", rows(printed(CASES, seeds)))


def rows(metrics: Metrics) -> dict[str, list[Figure]]:
    """The figures of each case, at the end the prints that went wrong without a warning."""
    found = {case.name: figures(case, metrics) for case in CASES}
    mae, std, highest, layers = found[IN_REGISTER.name]
    unlooked = found[AS_THEY_ARE.name][0].now
    found[IN_REGISTER.name] = [replace(mae, must=unlooked + LOSS_UM, aim=unlooked), std, highest, layers]
    for case in SHIFTED:
        error, std, above, shift = found[case.name]
        aims = (replace(each, aim=best.now + TOLERANCE_UM) for each, best in ((error, mae), (above, highest)))
        found[case.name] = [next(aims), std, next(aims), shift]
    silent = float(sum(_too_high(metrics, case) for case in CASES))
    name = f"prints with a cell above the open loop's highest and {board.HIGH_UM:g} um above target, no warning"
    return {**found, "all of these": [Figure(name, [silent], 0.0, 0.0)]}


def _too_high(metrics: Metrics, case: Case) -> int:
    """Number of prints of a case that end higher than any cell of the open loop without a warning."""
    reference = next(each for each in CASES if each.scenario == case.scenario and OPEN_LOOP in each.planners)
    highest, untrusted = (column(metrics, case, OURS, name) for name in ("highest", "untrusted"))
    prints = zip(highest, untrusted, column(metrics, reference, OPEN_LOOP, "highest"), strict=True)
    return sum(layers == 0.0 and board.is_above(own, open_loop) for own, layers, open_loop in prints)
