"""`inkloop sweep`: print a study, and say what it found."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from inkloop.errors import InkloopError, ResultError
from inkloop.files import RUNS
from inkloop.master.interrupt import advised, deferred
from inkloop.printing.run import INTERRUPTED, new_run_folder
from inkloop.report.terminal import Terminal
from inkloop.results.lock import sole_writer
from inkloop.results.study_folder import STUDY_STATE_FILE
from inkloop_lab.sweep import dataset, report, summary
from inkloop_lab.sweep.engine import Site, carry_out
from inkloop_lab.sweep.folder import PRINTS_FOLDER, StudyFolder
from inkloop_lab.sweep.plan import OptimisePlan, Plan, PointsPlan
from inkloop_lab.sweep.sites import fitting, on_cluster, on_processes
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Bundle, Order, Record

SOME_FAILED = 3  # exit code of a sweep whose other prints are done


def sweep(options: argparse.Namespace, console: Terminal) -> int:
    """The exit code of the command. Raises InkloopError."""
    study = Study.load(options.study)
    plan = OptimisePlan(study, study.tables.optimise) if study.tables.optimise else PointsPlan(study)
    source = Path(study.scenario.source)
    values = [list(each) for each in (*study.axes.values(), *(study.samples.values.values() if study.samples else ()))]
    values += [list(spread.parameters) for spread in study.search.values()]
    bundle = Bundle.of(study.scenario.text, source, values)
    console.sentence(f"{study.path}: {_size(study, plan)}")
    _check_place(study, options)
    if options.check:
        console.result(points=study.count, prints=plan.total, keys=summary.keys_of(study))
        return 0
    folder = _folder(options)
    with sole_writer(folder), deferred() as interrupted, advised(lambda: _kept(folder, options)):
        own = StudyFolder(folder, study, bundle)
        if own.records:
            console.sentence(f"{folder}: {len(own.records)} prints are recorded already")
        with (
            _site(options, study, bundle, folder, console) as site,
            _resumable(folder, options),
            _progress(console, study, plan) as on_record,
        ):
            whole = carry_out(plan, site, own, interrupted, on_record)
        found = report.sweep_of(study, own, plan)
        dataset.write(found, folder)
        failed = report.report(study, found, plan, folder, options.pictures, console, is_whole=whole)
        if isinstance(plan, OptimisePlan) and plan.best is not None:
            report.write_best(study, plan, plan.best, bundle, folder, console)
    prints = len(own.records)
    if not whole:
        console.sentence(
            f"interrupted: {prints} of {plan.total} prints are recorded; continue with `{_again(folder, options)}`"
        )
    elif failed:
        console.sentence(
            f"{failed} of {prints} prints failed; `error` of {folder / dataset.SWEEP_FILE} says why", "bold"
        )
    return INTERRUPTED if not whole else SOME_FAILED if failed else 0


def _size(study: Study, plan: Plan) -> str:
    if study.tables.optimise:
        return f"{study.tables.optimise.trials} trials of {study.tables.seeds.count} prints: {plan.total} prints"
    lengths = " x ".join(f"{length} {name.rpartition('.')[2]}" for name, length in study.shape.items()) or "1 point"
    seeds = study.tables.seeds
    until = f" to {seeds.max}" if seeds.until else ""
    return f"{lengths}, {seeds.count}{until} seeds each: {'from ' if until else ''}{plan.total} prints"


def _check_place(study: Study, options: argparse.Namespace) -> None:
    """Raises InkloopError for run folders on machines that may not see the folder of the study."""
    keep = study.tables.keep
    if options.scheduler and (keep.maps == "all" or keep.layers):
        asked = 'keep.maps = "all"' if keep.maps == "all" else "keep.layers = true"
        raise InkloopError(
            f"{study.path}: {asked} writes run folders, and the machines of a cluster may not see this disk; write "
            'keep.maps = "final" or "none" and leave out keep.layers, or leave out --scheduler'
        )


def _folder(options: argparse.Namespace) -> Path:
    """The folder of the study: a new one, or with --resume the one of before. Raises ResultError."""
    out: Path | None = options.out
    name = options.study.stem
    if not options.resume:
        if out is not None and (out / STUDY_STATE_FILE).is_file():
            raise ResultError(f"{out}: holds a study; add --resume to continue it, or name another --out")
        return new_run_folder(out, name)
    if out is None:
        begun = [path.parent for path in RUNS.glob(f"{name}*/{STUDY_STATE_FILE}")]
        own = [
            path for path in begun if path.name.removeprefix(name).removeprefix("-").isdecimal() or path.name == name
        ]
        if not own:
            raise ResultError(
                f"{RUNS / name}: no study was begun there; leave out --resume, or name its folder by --out"
            )
        return max(own, key=lambda path: (len(path.name), path.name))
    if not (out / STUDY_STATE_FILE).is_file():
        raise ResultError(f"{out}: holds no study; leave out --resume, or name the folder of a study")
    return out


def _again(folder: Path, options: argparse.Namespace) -> str:
    scheduler = f" --scheduler {options.scheduler}" if options.scheduler else ""
    workers = f" --workers {options.workers}" if options.workers else ""
    return f"inkloop sweep {options.study} --out {folder} --resume{workers}{scheduler}"


@contextmanager
def _resumable(folder: Path, options: argparse.Namespace) -> Iterator[None]:
    """An error that ends a study says how to continue it."""
    try:
        yield
    except InkloopError as error:
        raise ResultError(f"{error}\n{_kept(folder, options)}") from error


def _kept(folder: Path, options: argparse.Namespace) -> str:
    return f"prints that have ended are kept; continue with `{_again(folder, options)}`"


def _site(
    options: argparse.Namespace, study: Study, bundle: Bundle, folder: Path, console: Terminal
) -> AbstractContextManager[Site]:
    """Where the prints are made. Raises InkloopError."""
    keep = study.tables.keep
    in_folders = keep.maps == "all" or keep.layers
    source = str(Path(study.scenario.source).resolve())
    runs = str((folder / PRINTS_FOLDER).resolve()) if in_folders else None
    order = Order(study.scenario.text, source, runs, keep.maps == "final")
    if options.scheduler:
        return on_cluster(options.scheduler, order, bundle)
    controllers = study.scenario.tables.components.values()
    threads = [table.options.get("threads") for table in controllers]
    threads += [value for key, values in study.axes.items() if key.endswith(".threads") for value in values]
    workers, note = fitting(options.workers, max((each for each in threads if isinstance(each, int)), default=1))
    if note:
        console.sentence(f"{note} at a time")
    return on_processes(workers, order)


@contextmanager
def _progress(console: Terminal, study: Study, plan: Plan) -> Iterator[Any]:
    """A bar over all prints, with the time left; yields what is called with each record."""
    ended = {"done": 0, "failed": 0}
    with console.progress("figures") as progress:
        bar = progress.add_task(study.title, total=plan.total, figures="")

        def on_record(record: Record) -> None:
            ended["done"] += 1
            ended["failed"] += record.status in dataset.FAILING
            if console.verbose:
                note = record.error or ", ".join(f"{name} {value:.3g}" for name, value in record.metrics.items())
                console.sentence(f"point {record.point}, print {record.replicate}: {record.status}: {note}")
            failed = f", {ended['failed']} failed" if ended["failed"] else ""
            figures = f"{ended['done']} of {plan.total} prints{failed}"
            progress.update(bar, completed=ended["done"], total=plan.total, figures=figures)

        yield on_record
