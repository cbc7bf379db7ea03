"""Tables, pictures, files and page of a study that has been printed, or of as much of it as there is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop.errors import ResultError
from inkloop.files import reason_of, replaced, write_text
from inkloop.report.terminal import NumberTable, Terminal
from inkloop.scenario.file import Scenario
from inkloop_lab.sweep import dataset, summary
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.plan import OptimisePlan, Plan
from inkloop_lab.sweep.sensitivity import with_indices
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Bundle

if TYPE_CHECKING:
    import xarray as xr

SUMMARY_FILE = "summary.txt"
BEST_FOLDER = "best"
PAGE_ROWS_MAX = 2000
"""Points in the table of the page; of more, the best are shown."""


def sweep_of(study: Study, folder: StudyFolder, plan: Plan) -> xr.Dataset:
    """All that the study's file holds. Raises ResultError."""
    settings = plan.settings if isinstance(plan, OptimisePlan) else ()
    found = dataset.dataset(study, folder, settings)
    if study.samples is not None and study.samples.blocks and study.tables.metric in found:
        seed = study.tables.sample.seed if study.tables.sample else 0
        found = with_indices(found, list(study.samples.values), seed)
    return found


def report(
    study: Study,
    found: xr.Dataset,
    plan: Plan,
    folder: Path,
    formats: Sequence[str],
    console: Terminal,
    *,
    is_whole: bool,
) -> int:
    """Show and write tables and pictures; how many prints failed."""
    points = summary.points(study, found)
    all_points = summary.table_of_points(study, points, PAGE_ROWS_MAX)
    indices = [summary.table_of_indices(study, found)] if "first_order" in found else []
    table = indices[0] if indices else summary.table_of_points(study, points)
    errors = summary.errors_of(found)
    status = found["status"].values
    failing = [dataset.STATUSES.index(each) for each in dataset.FAILING]
    failed = int(sum((status == code).sum() for code in failing))
    prints = int((status > 0).sum())
    values = plan.values if isinstance(plan, OptimisePlan) else ()
    won = "" if isinstance(plan, OptimisePlan) else summary.winner(study, points)
    written = []
    try:
        with replaced(folder / SUMMARY_FILE) as partial, partial.open("w", encoding="utf-8") as file:
            Terminal(file).print(table, won)
        if formats:
            from inkloop.report import plot  # Matplotlib takes a second to import
            from inkloop_lab.sweep.pictures import pictures

            for name, figure in pictures(study, points, found, values).items():
                written += plot.save(figure, folder / name, formats)
        size = f"{prints} of {plan.total} prints of {study.tables.scenario}; {failed or 'none'} failed."
        sentences = [size, won or _best_words(plan)]
        write_text(folder / PAGE_FILE, page(study, sentences, [*indices, all_points], errors, written))
    except OSError as error:
        raise ResultError(f"{folder}: tables and pictures cannot be written: {reason_of(error)}") from error
    console.print(table)
    if won:
        console.sentence(won)
    for text, count in errors[: summary.ERRORS_MAX]:
        console.sentence(f"{count} prints failed: {text}" if count > 1 else f"1 print failed: {text}")
    files = ", ".join([dataset.SWEEP_FILE, PAGE_FILE, SUMMARY_FILE, *(path.name for path in written)])
    console.sentence(f"{folder}/: {files}")
    console.result(
        folder=folder,
        interrupted=not is_whole,
        prints=prints,
        failed=failed,
        points=points,
        indices=_indices(found),
        best=_best(plan),
    )
    return failed


def _indices(found: xr.Dataset) -> Any:
    """The indices as plain tables, by metric and key."""
    if "first_order" not in found or len(found["first_order"].dims) > 2:
        return None
    names = [f"{order}{end}" for order in ("first_order", "total_order") for end in ("", "_low", "_high", "_error")]
    return {
        str(metric): {
            str(key): {name: float(found[name].values[m, k]) for name in names}
            for k, key in enumerate(found["key"].values)
        }
        for m, metric in enumerate(found["metric"].values)
    }


def _best(plan: Plan) -> Mapping[str, Any] | None:
    if not isinstance(plan, OptimisePlan) or plan.best is None:
        return None
    return {"trial": plan.best, "value": plan.values[plan.best], "keys": plan.settings[plan.best]}


def write_best(study: Study, plan: OptimisePlan, best: int, bundle: Bundle, folder: Path, console: Terminal) -> None:
    """Write the scenario of the best trial with its files, ready to be printed."""
    setting = plan.settings[best]
    source = Path(study.scenario.source)
    text = Scenario.of_text(study.scenario.text, str(source), setting).text
    place = folder / BEST_FOLDER
    try:
        scenario = Bundle(text, bundle.place, bundle.files).write(place)
        lines = [f"# trial {best} of {study.path.name}: {plan.values[best]:.6g}", text]
        write_text(scenario, "\n".join(lines))
    except OSError as error:
        raise ResultError(f"{place}: the best scenario cannot be written: {reason_of(error)}") from error
    console.sentence(f"{_best_words(plan)}; scenario {scenario}")


def _best_words(plan: Plan) -> str:
    """The best trial of a search; nothing of other studies."""
    if not isinstance(plan, OptimisePlan) or plan.best is None:
        return ""
    setting = plan.settings[plan.best]
    names = summary.short_names(list(setting))
    words = ", ".join(f"{names[key]} {summary.text_of(value)}" for key, value in setting.items())
    return f"{plan.aim} of {len(plan.values)} trials: {words}: {plan.values[plan.best]:.4g}"


PAGE_FILE = "study.html"
SHOWN = (".png", ".svg")
"""Pictures that browsers show; others are linked."""
HEADINGS = {
    "main-effects": "Each key, over all values of the others",
    "heat-map": "The two strongest keys",
    "front": "Roughness against layers",
    "sensitivities": "What decides: shares of the variance",
    "search": "The search, trial by trial",
}
"""Name of a picture -> heading of it on the page."""
_STYLE = """
:root { color-scheme: light dark }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em }
table { border-collapse: collapse; display: block; overflow-x: auto }
caption { text-align: left; padding: 0.3em 0; opacity: 0.7 }
th, td { padding: 0.15em 0.8em; text-align: right; border-bottom: 1px solid #8884 }
th:first-child, td:first-child { text-align: left }
img { max-width: 100%; background: white; margin: 0.5em 0 }
pre { overflow-x: auto }
"""


def page(
    study: Study,
    sentences: Sequence[str],
    tables: Sequence[NumberTable],
    errors: Sequence[tuple[str, int]],
    pictures: Sequence[Path],
) -> str:
    """HTML that loads nothing but the pictures, which lie in its folder.

    sentences: on what was printed and found; errors: texts with how many prints failed of each.
    """
    parts = [f"<h1>{escape(study.title)}</h1>"]
    parts += [f"<p>{escape(text[:1].upper() + text[1:])}</p>" for text in sentences if text]
    parts += [_picture(path) for path in pictures]
    parts += [_table(table) for table in tables]
    if errors:
        rows = "".join(f"<li>{count}: {escape(text)}</li>" for text, count in errors)
        parts.append(f"<h2>Prints that failed</h2><ul>{rows}</ul>")
    sources = {"The study": study.text, "The scenario": study.scenario.text}
    parts += _sources(sources)
    head = f'<meta charset="utf-8"><title>{escape(study.title)}</title><style>{_STYLE}</style>'
    return "\n".join(["<!doctype html>", '<html lang="en">', head, *parts, "</html>", ""])


def _picture(path: Path) -> str:
    """A picture under its heading, or a link to one that browsers do not show."""
    name = escape(path.name)
    link = f'<p><a href="{name}">{{}}</a></p>'
    if path.suffix not in SHOWN:
        return link.format(name)
    heading = HEADINGS[path.stem]
    image = f'<img src="{name}" alt="{heading}">'
    return f"<h2>{heading}</h2>{link.format(image)}"


def _table(table: NumberTable) -> str:
    """A table of the terminal with all of its rows."""
    columns = [[str(cell) for cell in column.cells] for column in table.columns]
    heads = "".join(f"<th>{escape(' '.join(str(column.header).split()))}</th>" for column in table.columns)
    rows = "\n".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in zip(*columns, strict=True)
    )
    caption = f"<caption>{escape(table.note)}</caption>" if table.note else ""
    return f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>\n{rows}\n</tbody></table>"


def _sources(texts: Mapping[str, str]) -> Iterator[str]:
    for name, text in texts.items():
        yield f"<details><summary>{name}</summary><pre>{escape(text)}</pre></details>"
