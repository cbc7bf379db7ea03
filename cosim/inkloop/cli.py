"""The `inkloop` command."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from inkloop import __version__, fmu
from inkloop.bench import commands as bench_commands
from inkloop.bench import doctor, replay
from inkloop.errors import InkloopError, ScenarioError
from inkloop.exchange.job import command as job_command
from inkloop.exchange.ssp import command as ssp_command
from inkloop.exchange.ssp import reading as ssp_reading
from inkloop.files import write_text
from inkloop.fmu_writer.export import export
from inkloop.identify import command as identify_command
from inkloop.printing.isolation import run_isolated
from inkloop.printing.run import new_run_folder, resume, run, scenario_file, scenario_of
from inkloop.report import run_report
from inkloop.results.result import SCENARIO_FILE
from inkloop.scenario import new as templates
from inkloop.scenario.file import Scenario
from inkloop.scenario.json_schema import scenario_schema
from inkloop.studies.reproduce import command as reproduce
from inkloop.studies.score import command as score


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it did what was asked, 1 when it could not, 130 when it was interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser().parse_args(words, argparse.Namespace(words=words))
    console = Console(width=None if sys.stdout.isatty() else 120)
    try:
        return int(options.command(options, console))
    except InkloopError as error:
        print(error, file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader, `head` for example, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="inkloop", description="Closed-loop ink-jet 3D printing as a co-simulation.")
    parser.add_argument("--version", action="version", version=f"inkloop {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    print_it = commands.add_parser("run", help="print the part of a scenario: table, pictures and result file")
    _add_scenario(print_it)
    print_it.add_argument("--out", type=Path, metavar="DIR", help="run folder (default: runs/NAME, never overwritten)")
    print_it.add_argument("--no-compare", action="store_true", help="leave out the scenario's comparison runs")
    _add_isolate(print_it)
    print_it.set_defaults(command=_run)

    go_on = commands.add_parser("resume", help="go on with a run after its last layer, however it was stopped")
    go_on.add_argument("run", type=Path, metavar="RUN")
    _add_isolate(go_on)
    go_on.set_defaults(command=_resume)

    validate = commands.add_parser("validate", help="check a scenario and name every fault")
    _add_scenario(validate)
    validate.set_defaults(command=_validate)

    again = commands.add_parser("report", help="make table and pictures of a run folder again")
    again.add_argument("run", type=Path, metavar="RUN")
    again.set_defaults(command=_report)

    compare = commands.add_parser("compare", help="put several runs of one grid into one table and one picture")
    compare.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    compare.add_argument("--out", type=Path, default=Path("compare.png"), metavar="FILE",
                         help="picture to write (default: compare.png)")  # fmt: skip
    compare.set_defaults(command=_compare)

    new = commands.add_parser("new", help="write a commented scenario to start from")
    new.add_argument("name", type=Path, metavar="NAME", help="writes NAME.toml")
    new.add_argument("--shape", choices=tuple(templates.PARTS), default="cylinder", help="default: cylinder")
    new.set_defaults(command=_new)

    schema = commands.add_parser("schema", help="print the JSON Schema of scenario files, for editors")
    schema.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: print it)")
    schema.set_defaults(command=_schema)

    write = commands.add_parser("export", help="write one of our FMUs for a grid")
    write.add_argument("model", metavar="MODEL", help="LayerDeposition, ProfileSensor, ...; a wrong name lists them")
    write.add_argument("--fmi", choices=("2", "3"), default="3", help="FMI version (default 3)")
    write.add_argument("--nx", type=int, default=9, help="cells along x (default 9)")
    write.add_argument("--ny", type=int, default=9, help="cells along y (default 9)")
    write.add_argument(
        "--fixed", action="store_true", help="FMI 3 with constant dimensions, for tools that cannot resize"
    )
    write.add_argument(
        "--windows", action="store_true", help="add a binary for 64-bit Windows; needs mingw-w64 on this machine"
    )
    write.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: MODEL.fmu)")
    write.set_defaults(command=_export)

    system = ssp_command.add_parser(commands)
    _add_overrides(system)
    system.set_defaults(command=_export_ssp)

    job = job_command.add_parser(commands)
    _add_overrides(job)
    job.set_defaults(command=_export_job)

    info = commands.add_parser("info", help="show what an FMU is and offers, or how a run came about and ended")
    info.add_argument("path", type=Path, metavar="FMU|RUN", help="an .fmu file or a run folder")
    info.set_defaults(command=_info)

    reproduce.add_parser(commands).set_defaults(command=reproduce.reproduce)
    score.add_parser(commands).set_defaults(command=score.score)

    find_ink = identify_command.add_parser(commands)
    _add_overrides(find_ink)
    find_ink.set_defaults(command=_identify)

    bench, device = bench_commands.add_parsers(commands)
    bench.add_argument("scenario", type=Path, nargs="?", metavar="SCENARIO", help="a .toml file: grid, ink and sensor")
    bench.set_defaults(command=_bench)
    device.set_defaults(command=_device)
    look = doctor.add_parser(commands)
    look.set_defaults(command=_doctor)
    from_log = replay.add_parser(commands)
    from_log.set_defaults(command=_replay)
    for on_a_bench in (bench, device, look, from_log):
        _add_overrides(on_a_bench)
    return parser


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="a .toml file, or an .ssp")
    parser.add_argument("--job", type=Path, metavar="FILE", help="an .ssp: the scenario that it is laid over, "
                        "with the part and what is no FMU (default: the one in it)")  # fmt: skip
    _add_overrides(parser)


def _add_overrides(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
                        help="override a key, e.g. components.controller.alpha=0.5; may be repeated")  # fmt: skip


def _add_isolate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--isolate",
        action=argparse.BooleanOptionalAction,
        help="print in a process of its own, so that crashing native code ends in words "
        "(default: where a component is an FMU of others)",
    )


def _scenario(options: argparse.Namespace) -> Scenario:
    """The scenario of the command line; classes that it names as "module:Class" may stand beside it."""
    job = getattr(options, "job", None)
    sys.path.append(str((job or options.scenario).parent.resolve()))
    if options.scenario.suffix == ssp_reading.SUFFIX:
        return ssp_reading.scenario_of(options.scenario, options.overrides, job)
    if job is not None:
        raise ScenarioError(str(options.scenario), [f"--job {job}: --job goes with an .ssp; leave it out"])
    return Scenario.load(options.scenario, options.overrides)


def _run(options: argparse.Namespace, console: Console) -> int:
    scenario = _scenario(options)
    if _is_isolated(options, scenario):
        folder = new_run_folder(options.out, options.scenario.stem)
        return run_isolated([*options.words, "--no-isolate", "--out", str(folder)], folder, scenario.foreign_fmus)
    return run(scenario, options.out, console, compare=not options.no_compare)


def _resume(options: argparse.Namespace, console: Console) -> int:
    sys.path.append(str(scenario_file(options.run).parent))
    scenario = scenario_of(options.run)
    if _is_isolated(options, scenario):
        return run_isolated([*options.words, "--no-isolate"], options.run, scenario.foreign_fmus)
    return resume(options.run, console)


def _bench(options: argparse.Namespace, console: Console) -> int:
    return bench_commands.emulate(_scenario(options) if options.scenario else None, options, console)


def _device(options: argparse.Namespace, console: Console) -> int:
    folder = options.scenario
    if not folder.is_dir():
        return bench_commands.act(_scenario(options), options, console)
    source = scenario_file(folder)
    sys.path.append(str(source.parent))
    return bench_commands.act(Scenario.load(folder / SCENARIO_FILE, options.overrides, source=source), options, console)


def _doctor(options: argparse.Namespace, console: Console) -> int:
    try:
        scenario = _scenario(options) if options.scenario else None
    except ScenarioError as error:
        print(error, file=sys.stderr)
        return doctor.CANNOT_RUN
    return doctor.examine(scenario, options, console)


def _replay(options: argparse.Namespace, console: Console) -> int:
    sys.path.append(str(scenario_file(options.run).parent))
    return replay.replay(options, console)


def _identify(options: argparse.Namespace, console: Console) -> int:
    sys.path.append(str(Path(options.sources[0]).parent.resolve()))  # classes named as "module:Class"
    return identify_command.run(options, console)


def _is_isolated(options: argparse.Namespace, scenario: Scenario) -> bool:
    return bool(scenario.foreign_fmus) if options.isolate is None else bool(options.isolate)


def _validate(options: argparse.Namespace, console: Console) -> int:
    scenario = _scenario(options)
    grid = scenario.tables.grid
    printed = int(scenario.job().mask.sum())
    console.print(f"{options.scenario}: no fault; {grid.nx} x {grid.ny} cells, {printed} printed, "
                  f"components {', '.join(scenario.tables.components)}", highlight=False)  # fmt: skip
    return 0


def _report(options: argparse.Namespace, console: Console) -> int:
    console.print(run_report.write(options.run))
    if (options.run / run_report.MODEL_TABLE).is_file():
        console.print((options.run / run_report.MODEL_TABLE).read_text(encoding="utf-8"), highlight=False, markup=False)
    return 0


def _compare(options: argparse.Namespace, console: Console) -> int:
    console.print(run_report.compare(options.runs, options.out))
    console.print(f"wrote {options.out}", highlight=False)
    return 0


def _new(options: argparse.Namespace, console: Console) -> int:
    path = templates.write(options.name, options.shape)
    console.print(f"wrote {path}; inkloop run {path} prints it", highlight=False)
    return 0


def _schema(options: argparse.Namespace, console: Console) -> int:
    text = json.dumps(scenario_schema(), indent=2)
    if options.out is None:
        print(text)
    else:
        write_text(options.out, text + "\n")
        console.print(f"wrote {options.out}", highlight=False)
    return 0


def _export(options: argparse.Namespace, console: Console) -> int:
    path = export(options.model, fmi=options.fmi, nx=options.nx, ny=options.ny, fixed=options.fixed,
                  out=options.out or Path(f"{options.model}.fmu"), windows=options.windows)  # fmt: skip
    console.print(f"wrote {path}", highlight=False)
    return 0


def _export_ssp(options: argparse.Namespace, console: Console) -> int:
    return ssp_command.export(_scenario(options), options, console)


def _export_job(options: argparse.Namespace, console: Console) -> int:
    return job_command.export(_scenario(options), options, console)


def _info(options: argparse.Namespace, console: Console) -> int:
    lines = run_report.lines(options.path) if options.path.is_dir() else fmu.describe(options.path).lines()
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 0
