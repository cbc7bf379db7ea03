"""Run the notebooks of docs/notebooks and keep their outputs: python -m tools.notebooks [NAME ...].

A notebook is run from the first cell to the last, in a copy of its folder beside one of the scenarios, so that the tree
stays as it is. Times of day and of cells are left out, so that the same outputs are the same file.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import nbformat as untyped
from nbclient import NotebookClient

from inkloop.files import write_text

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = tuple(sorted(path.stem for path in FOLDER.glob("*.ipynb")))
nbformat: Any = untyped
CELL_S = 1800
"""A cell that takes longer is ended (assumed)."""
KERNEL = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}


def read(name: str) -> Any:
    """A notebook of the folder."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def executed(notebook: Any) -> Any:
    """The notebook with the outputs of a run. Raises nbclient's CellExecutionError."""
    with tempfile.TemporaryDirectory() as copy:
        for folder in (FOLDER, ROOT / "scenarios"):
            shutil.copytree(folder, copy / folder.relative_to(ROOT))
        place = str(copy / FOLDER.relative_to(ROOT))
        client = NotebookClient(notebook, timeout=CELL_S, resources={"metadata": {"path": place}})
        return normal(asyncio.run(client.async_execute()))


def normal(notebook: Any) -> Any:
    """The notebook without what differs between two runs: times, ids, parts of a stream, texts beside a better view."""
    notebook.metadata = nbformat.from_dict(KERNEL)
    for number, cell in enumerate(notebook.cells):
        cell.id, cell.metadata = f"cell-{number}", nbformat.from_dict({})
        if cell.cell_type == "code":
            cell.outputs = list(_outputs(cell.outputs))
    return notebook


def _outputs(outputs: Iterable[Any]) -> Iterator[Any]:
    for kind, group in groupby(outputs, lambda output: (output.output_type, output.get("name"))):
        if kind[0] == "stream":
            yield nbformat.v4.new_output("stream", name=kind[1], text="".join(part.text for part in group))
            continue
        for output in group:
            if "data" in output and len(output.data) > 1:
                output.data.pop("text/plain", None)
            yield output


def texts(notebook: Any) -> Iterator[tuple[int, str]]:
    """What the cells print and show as text, with the number of the cell."""
    for number, cell in enumerate(notebook.cells):
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if text := output.get("text") or data.get("text/html") or data.get("text/plain"):
                yield number, text


def main() -> None:
    """Run the notebooks named, or all, and write them."""
    parser = argparse.ArgumentParser(prog="python -m tools.notebooks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default: {', '.join(NOTEBOOKS)}")
    names = parser.parse_args().names or NOTEBOOKS
    if unknown := [name for name in names if name not in NOTEBOOKS]:
        parser.error(f"no notebook called {', '.join(unknown)}; there are {', '.join(NOTEBOOKS)}")
    for name in names:
        print(f"{name} ...", file=sys.stderr, flush=True)
        write_text(FOLDER / f"{name}.ipynb", nbformat.writes(executed(read(name))) + "\n")


if __name__ == "__main__":
    main()
