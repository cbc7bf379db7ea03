"""`inkloop metrology`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.metrology import UNITS
from inkloop.metrology.evaluation.definitions import F_OPERATIONS
from inkloop.results import SURFACES


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "metrology", help="evaluate a surface: areal and profile parameters, form, outline, volume"
    )
    parser.add_argument("source", type=Path, metavar="RUN|MAP", help="run folder, or height map of a profiler")
    parser.add_argument("--layer", type=int, metavar="N", help="of a run: after N layers (default: last)")
    parser.add_argument("--map", choices=SURFACES, help="of a run: surface to evaluate (default: printed)")
    parser.add_argument(
        "--mask", metavar="part|all|FILE", help="cells that count; an NPY file (default: part of a run, all of a map)"
    )
    parser.add_argument("--s-filter-um", type=float, metavar="L", help="remove waves shorter than this (default: none)")
    parser.add_argument("--l-filter-um", type=float, metavar="L", help="remove waves longer than this (default: none)")
    parser.add_argument(
        "--filter-order",
        type=int,
        choices=(0, 1),
        default=1,
        help="regression order of the Gaussian filters: 0 keeps constants, 1 planes up to the edge (default: 1)",
    )
    parser.add_argument(
        "--f-operation",
        choices=F_OPERATIONS,
        default="plane",
        help="taken off the heights: nothing but their mean, the least-squares plane (default), a polynomial of second "
        "order, or the target of the run",
    )
    parser.add_argument("--profile", choices=("x", "y"), help="profile parameters of the rows along this axis instead")
    parser.add_argument("--unit", choices=UNITS, help="of the heights of a map that does not give it")
    parser.add_argument("--pixel-um", type=float, metavar="P", help="pixel spacing of a map that does not give it")
    parser.add_argument("--count-scale", type=float, metavar="H", help="height of one count, for whole-number maps")
    parser.add_argument("--invalid-value", type=float, metavar="V", help="number of a pixel without a height")
    return parser


def run(options: argparse.Namespace) -> int:
    """Show the parameters; the exit code."""
    from dataclasses import replace

    from inkloop.errors import HeightMapError
    from inkloop.metrology.evaluation.subject import Subject
    from inkloop.report import surface_parameters
    from inkloop.results.result import Result
    from inkloop.results.surface import subject_of

    source, is_run = options.source, options.source.is_dir()
    alien = ("unit", "pixel_um", "count_scale", "invalid_value") if is_run else ("layer", "map")
    if given := [f"--{name.replace('_', '-')}" for name in alien if getattr(options, name) is not None]:
        raise HeightMapError(f"{source}: is a {'run' if is_run else 'map'}; leave {' and '.join(given)} out")
    mask = options.mask or ("part" if is_run else "all")
    if is_run:
        run_ = Result.load(source).dataset
        of_run = subject_of(run_, str(source), name=options.map or SURFACES[0], layer=options.layer)
        subject = replace(of_run, mask=surface_parameters.mask_of(of_run.map_, of_run.mask, mask))
    else:
        map_ = surface_parameters.read(options)
        subject = Subject(map_, surface_parameters.mask_of(map_, None, mask))
    return surface_parameters.show(subject, mask, options, screen(options))
