"""`inkloop export`: files for other tools."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

from inkloop.commands import Part
from inkloop.commands.options import (
    add_overrides,
    add_platforms,
    overrides_of,
    scenario_of,
    screen,
    show_written,
)
from inkloop.commands.parts import add_part_options, no_part_options, scenario_of_part
from inkloop.errors import ResultError, require
from inkloop.exchange.layers import BITMAP_FORMATS, DROP_SPLITS, MAP_FORMATS, MESH_FORMATS
from inkloop.exchange.ssp import FORMATS, VERSIONS
from inkloop.results import SURFACES

SCENARIOS = (".toml", ".ssp")


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command, which its parts are added to."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "export", help="write files for other tools: FMUs, systems of FMUs, layers, surfaces, services of nodes"
    )
    return parser


def _add_fmu(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "fmu", help="write one of inkloop's FMUs for a grid of your size"
    )
    parser.add_argument("model", metavar="MODEL", help="LayerDeposition, ProfileSensor, ...; an unknown name lists all")
    parser.add_argument("--fmi", choices=("2", "3"), default="3", help="FMI version (default: 3)")
    parser.add_argument("--nx", type=int, default=9, metavar="N", help="cells along x (default: 9)")
    parser.add_argument("--ny", type=int, default=9, metavar="N", help="cells along y (default: 9)")
    parser.add_argument(
        "--intervals",
        type=int,
        metavar="N",
        help="LayerController: intervals of height that the region of ink A may have on a cell (default: 2)",
    )
    parser.add_argument(
        "--fixed", action="store_true", help="FMI 3 with constant dimensions, for tools that cannot resize arrays"
    )
    add_platforms(parser)
    parser.add_argument(
        "--force", action="store_true", help="FMI 2 also for a grid whose description many tools cannot read"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: MODEL.fmu)")
    return parser


def _export_fmu(options: argparse.Namespace) -> int:
    from inkloop.fmu_writer.export import export_fmu

    names = ("fmi", "nx", "ny", "intervals", "fixed", "platforms", "force")
    chosen = {name: getattr(options, name) for name in names}
    return show_written(options, export_fmu(options.model, out=options.out or Path(f"{options.model}.fmu"), **chosen))


def _add_ssp(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "ssp", help="write a scenario as a system of FMUs for other tools: SSP, libcosim, Maestro"
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file (.toml)")
    about = "file to write, for osp and maestro a new folder (default: NAME.ssp, NAME-osp, ...)"
    parser.add_argument("-o", "--out", type=Path, metavar="PATH", help=about)
    parser.add_argument("--to", choices=FORMATS, default="ssp", help="format to write (default: ssp)")
    parser.add_argument(
        "--ssp",
        choices=tuple(VERSIONS),
        default="1.0",
        help="SSP version: 1.0 with FMI 2 and scalars (default), 2.0 with FMI 3 and arrays",
    )
    parser.add_argument("--fmi", choices=("2", "3"), help="FMI version of inkloop's FMUs in the system")
    add_platforms(parser)
    add_overrides(parser)
    return parser


def _export_ssp(options: argparse.Namespace) -> int:
    from inkloop.exchange.ssp import command

    with scenario_of(options) as scenario:
        return command.export(scenario, options, screen(options))


def _add_job(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "job", help="write a scenario as one FMU with scalar inputs and outputs, for tools without arrays"
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file (.toml)")
    parser.add_argument("--fmi", choices=("2", "3"), default="2", help="FMI version (default: 2)")
    add_platforms(parser)
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="file to write (default: NAME.fmu)")
    add_overrides(parser)
    return parser


def _export_job(options: argparse.Namespace) -> int:
    from inkloop.exchange import layer_job

    with scenario_of(options) as scenario:
        return layer_job.export(scenario, options, screen(options))


def _add_bench(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "bench", help="write the emulated bench of a scenario as one FMU on a CAN bus (FMI-LS-BUS)"
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file (.toml)")
    add_platforms(parser)
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="file to write (default: NAME-bench.fmu)")
    add_overrides(parser)
    return parser


def _export_bench(options: argparse.Namespace) -> int:
    from inkloop.bench import export

    with scenario_of(options) as scenario:
        return export.export(scenario, options, screen(options))


def _add_layers(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "layers", help="write the droplet patterns of each layer as bitmaps, for print heads"
    )
    about = "run folder; or scenario (.toml, .ssp) or part (STL, OBJ, PLY, 3MF, height map), of which the planned "
    parser.add_argument("scenario", type=Path, metavar="RUN|SCENARIO|FILE", help=f"{about}open loop is written")
    parser.add_argument("--format", choices=BITMAP_FORMATS, default="tiff", help="default: tiff, Group 4")
    parser.add_argument("--passes", action="store_true", help="separate the passes of a layer")
    parser.add_argument(
        "--drop-levels",
        choices=DROP_SPLITS,
        help="bitmaps of drops of several sizes: one for each size, or one for each bit of the level (default: planes)",
    )
    parser.add_argument("--layers", metavar="A-B", help="layers to write, from 1 (default: all)")
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="new folder to write (default: NAME-layers)")
    add_overrides(parser)
    add_part_options(parser)
    return parser


def _export_layers(options: argparse.Namespace) -> int:
    require("PIL", "inkloop export layers")
    from inkloop.exchange.layers import archive, patterns
    from inkloop.results.result import Result

    source: Path = options.scenario
    if source.is_file() and source.suffix not in SCENARIOS:
        scenario = scenario_of_part(options, source, overrides_of(options.overrides, str(source)))
        return archive.export(patterns.of_open_loop(scenario), source, options, screen(options))
    no_part_options(options)
    if not source.is_dir():
        with scenario_of(options) as scenario:
            return archive.export(patterns.of_open_loop(scenario), source, options, screen(options))
    if options.overrides:
        raise ResultError(f"{source}: --set goes with a scenario; a run keeps what was jetted: leave it out")
    return archive.export(patterns.of_run(Result.load(source), str(source)), source, options, screen(options))


def _add_surface(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "surface", help="write a surface of a run as a mesh or a height map, for metrology tools"
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, as written by `inkloop run`")
    parser.add_argument(
        "--format", choices=(*MESH_FORMATS, *MAP_FORMATS), required=True, help="closed body, or height map"
    )
    parser.add_argument("--layer", type=int, metavar="N", help="after N layers, 0: start surface (default: last)")
    parser.add_argument("--map", choices=SURFACES, default=SURFACES[0], help="surface to write (default: printed)")
    parser.add_argument("--part", action="store_true", help="the cells of the part only")
    parser.add_argument(
        "--fill-um", type=float, metavar="H", help="height of cells that have none (default: NaN; stl, glb: refused)"
    )
    about = "file to write (default: RUN-MAP-LNNNN with the format's suffix)"
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help=about)
    return parser


def _export_surface(options: argparse.Namespace) -> int:
    from inkloop.exchange.layers import surface

    return surface.export(options, screen(options))


def _add_services(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "services", help="write the diagnostic services of the nodes of a bench as a PDX file (ODX), for testers"
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="file to write, such as nodes.pdx")
    return parser


def _export_services(options: argparse.Namespace) -> int:
    require("odxtools", "inkloop export services")
    importlib.import_module("inkloop_hardware.protocol.odx_file").write_services(options.file)
    terminal = screen(options)
    terminal.sentence(f"wrote {options.file}: services of head, stage, cure lamp and profiler")
    terminal.result(file=options.file)
    return 0


def _add_schema(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "schema", help="print the JSON Schema of scenario files, for editors"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: standard output)")
    return parser


def _export_schema(options: argparse.Namespace) -> int:
    import json

    from inkloop.files import write_text
    from inkloop.scenario.json_schema import scenario_schema

    text = json.dumps(scenario_schema(), indent=2)
    if options.out is None:
        print(text)
        return 0
    write_text(options.out, text + "\n")
    return show_written(options, options.out)


PARTS = (
    Part(_add_fmu, _export_fmu),
    Part(_add_ssp, _export_ssp),
    Part(_add_job, _export_job),
    Part(_add_bench, _export_bench),
    Part(_add_layers, _export_layers),
    Part(_add_surface, _export_surface),
    Part(_add_services, _export_services),
    Part(_add_schema, _export_schema),
)
