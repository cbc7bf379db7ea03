"""Prints on an independent rig: scans with the errors of real profilers, foreign droplets, and scans that lie."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isinf, isnan, nan

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.prints import Figure
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from support.lying_scans.case import Case
from support.lying_scans.cases import CASES
from support.lying_scans.rig import DONE, STOPPED, Outcome, print_cases

PROCESSES = 2
HEADINGS = ("case", "mae, um", "highest, um", "lowest, um", "layers", "ended", "untrusted", "missed")
FIGURES = HEADINGS[1:5]


def measure(seeds: int = 3, only: Sequence[str] = ()) -> Table:
    """One row for each case; only: those whose name contains one of these texts (none: all).

    mae: mean over seeds; highest, lowest: of the worst seed; all three with what they must be, marked with ~ if that is
    by analogy and not of the design; layers: mean.
    """
    cases = [case for case in CASES.values() if not only or any(text in case.name for text in only)]
    outcomes = print_cases(cases, seeds, PROCESSES)
    found: dict[str, list[Outcome]] = {case.name: [] for case in cases}
    for outcome in track(outcomes, "prints", len(cases) * seeds, transient=True):
        found[outcome.case].append(outcome)
    shown = Table(title="prints with scans and droplets that are not as expected")
    for heading in HEADINGS:
        shown.add_column(heading, justify="right" if heading in FIGURES else "left", no_wrap=heading in FIGURES)
    missed = 0
    for case in cases:
        faults = misses(case, found[case.name])
        missed += bool(faults)
        shown.add_row(*_row(case, found[case.name]), ", ".join(faults) or "-")
    shown.caption = f"{len(cases) - missed} of {len(cases)} cases reach what they must"
    return shown


def misses(case: Case, prints: Sequence[Outcome]) -> list[str]:
    """Limits that the prints of a case miss, one text each."""
    must = case.must
    figures: Sequence[Figure] = _figures(case, prints)
    if must.or_stops and all(each.ending == STOPPED for each in prints):
        figures = figures[1:]
    found = [
        f"{figure.name} {figure.now / figure.must:.1f} x" for figure in figures if figure.reached.startswith("MISSED")
    ]
    if not isnan(must.stop_by):
        found += _if(any(each.ending != STOPPED for each in prints), "does not stop")
        found += _if(any(each.ending == STOPPED and each.layers > must.stop_by for each in prints), "stops late")
    elif not must.or_stops and isnan(must.untrusted_by):
        found += _if(any(each.ending != DONE for each in prints), "does not end")
    warned = [nan if each.untrusted_from is None else each.untrusted_from for each in prints]
    if not isnan(must.untrusted_by):
        found += _if(any(not layer <= must.untrusted_by for layer in warned), "no warning in time")
    found += _if(must.trusted and not all(isnan(layer) for layer in warned), "not trusted")
    return found


def _figures(case: Case, prints: Sequence[Outcome]) -> tuple[Figure, Figure, Figure]:
    must = case.must
    return (
        Figure("mae", [each.mae for each in prints], _rounded_up(must.mae, 0.005)),
        Figure("highest", [each.highest for each in prints], _rounded_up(must.highest, 0.5), worst=True),
        Figure("lowest", [-each.lowest for each in prints], _rounded_up(-must.lowest, 0.5), worst=True),
    )


def _row(case: Case, prints: Sequence[Outcome]) -> tuple[str, ...]:
    must = case.must
    mae, highest, lowest = (figure.now for figure in _figures(case, prints))
    return (
        case.name,
        f"{mae:.2f}" + _limit(must.mae, case),
        f"{highest:.1f}" + _limit(must.highest, case),
        f"{-lowest:.1f}" + _limit(must.lowest, case),
        f"{np.mean([each.layers for each in prints]):.0f}",
        _endings(prints, must.stop_by),
        _warnings(case, prints),
    )


def _endings(prints: Sequence[Outcome], stop_by: float) -> str:
    """Ends of the seeds, once if they agree, and how it must end."""
    texts = [f"stopped at {each.layers}" if each.ending == STOPPED else each.ending for each in prints]
    wanted = "" if isnan(stop_by) else "; must stop" if isinf(stop_by) else f"; must stop by {stop_by:g}"
    return ", ".join(dict.fromkeys(texts)) + wanted


def _warnings(case: Case, prints: Sequence[Outcome]) -> str:
    """In how many prints, from which layer on, why; and what must be."""
    layers = [each.untrusted_from for each in prints if each.untrusted_from is not None]
    must = case.must
    wanted = "; must be trusted" if must.trusted else ""
    wanted += "" if isnan(must.untrusted_by) else f"; must be by {must.untrusted_by:g}"
    if not layers:
        return "never" + wanted
    reasons = UntrustedReason(int(np.bitwise_or.reduce([each.reasons for each in prints])))
    return f"{len(layers)} of {len(prints)} from {min(layers)}: {_names(reasons)}{wanted}"


def _names(reasons: UntrustedReason) -> str:
    return ", ".join(str(each.name).lower() for each in reasons) or "no reason given"


def _limit(must: float, case: Case) -> str:
    return "" if isnan(must) else f" / {'~' if case.must.own else ''}{must:g}"


def _rounded_up(must: float, half_a_digit: float) -> float:
    """The largest value that is shown as `must`, which is rounded."""
    return must + half_a_digit


def _if(condition: bool, text: str) -> Iterable[str]:
    return [text] if condition else []
