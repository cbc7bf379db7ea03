"""The pages of the repository as a site: `make site`; Sphinx reads this file, nothing imports it.

The source folder is the repository itself, so that a page is the same file here and on a code host. Its links to
pages, pictures and headings work in both. A link to another file or to a folder (a scenario, a module, a record) leads
to a page that shows the file in colours or lists the folder; what is added to the pages is the navigation alone.
The pages of the public API and of the commands are filled from the code, which the repository leaves to `help()` and
`--help`.
"""

from __future__ import annotations

import html
import shutil
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments.lexers import get_lexer_for_filename
from pygments.lexers.special import TextLexer
from pygments.util import ClassNotFound
from sphinx.addnodes import download_reference, pending_xref
from sphinx.application import Sphinx
from sphinx.builders.html import StandaloneHTMLBuilder
from sphinx.util.osutil import relative_uri
from tools.figures.pages import SITE, filled, writer

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests"))  # for `support`
_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = _PROJECT["name"]
release = version = _PROJECT["version"]
copyright = "the authors of inkloop, BSD-3-Clause"

extensions = ["myst_nb"]
root_doc = "README"
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
PROJECT_PAGES = ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "CODE_OF_CONDUCT.md")
include_patterns = ["README.md", *PROJECT_PAGES, "docs/**/*.md", "docs/notebooks/*.ipynb", "fmus/*/readme.md"]
exclude_patterns = [".*", "build", "runs", "dist"]
NAVIGATION = {
    "Tutorial": "docs/tutorial/*.md",
    "How-to": "docs/how-to/*.md",
    "Explanation": "docs/explanation/*.md",
    "Reference": "docs/reference/*.md",
    "Models": "fmus/*/readme.md",
    "Gallery": "docs/gallery/*.md",
    "Notebooks": "docs/notebooks/*.ipynb",
}
"""Headings of the navigation, and the pages below each, by file name."""

nitpicky = True
myst_heading_anchors = 6
nb_execution_mode = "off"  # the outputs that tools.notebooks keeps

html_theme = "furo"
html_title = f"{project} {version}"
html_copy_source = False
html_show_search_summary = False  # a summary is fetched, which browsers refuse to pages opened as files
html_use_index = False
pygments_style = "tango"
pygments_dark_style = "monokai"

FILES = "files"
"""Folder of the site with the pages of linked files; the path below it is that in the repository."""
_linked: set[Path] = set()


def add_navigation(_: Sphinx, docname: str, source: list[str]) -> None:
    """Put the table of contents, which a code host has no use for, at the end of the front page."""
    if docname != root_doc:
        return
    groups = {title: sorted(path.relative_to(ROOT) for path in ROOT.glob(pages)) for title, pages in NAVIGATION.items()}
    groups["Project"] = [Path(page) for page in PROJECT_PAGES]
    for title, pages in groups.items():
        entries = "\n".join(f"/{page.with_suffix('').as_posix()}" for page in pages)
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{entries}\n```\n"


def fill_from_code(app: Sphinx, docname: str, source: list[str]) -> None:
    """Fill the marks that the repository leaves empty."""
    page = Path(app.env.doc2path(docname))
    for name in SITE:
        if own := writer(name).texts().get(page):
            source[0] = filled(source[0], own)


def link_files(app: Sphinx, document: nodes.document) -> None:
    """Let links to files and folders of the repository that are no pages of the site lead to pages of them."""
    page = app.env.doc2path(app.env.current_document.docname)
    for link in list(document.findall(lambda node: isinstance(node, download_reference | pending_xref))):
        assert isinstance(link, nodes.Element)
        path = _file_of(link, Path(page))
        if path is None:
            continue
        _linked.add(path)
        target = relative_uri(app.builder.get_target_uri(app.env.current_document.docname), _address(path))
        link.replace_self(nodes.reference("", "", *link.children, internal=True, refuri=target))


def _file_of(link: nodes.Element, page: Path) -> Path | None:
    """The file or folder in the repository, relative to its root; None where a link leads elsewhere or nowhere."""
    if isinstance(link, pending_xref) and link.get("reftype") != "myst":
        return None
    target = str(link["reftarget"])
    path = (ROOT / target[1:] if target.startswith("/") else page.parent / target).resolve()
    is_there = path.is_dir() if isinstance(link, pending_xref) else path.is_file()
    return path.relative_to(ROOT) if is_there and path.is_relative_to(ROOT) else None


def _address(path: Path) -> str:
    return f"{FILES}/{path.as_posix()}.html"


def pages_of_files(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """The pages of linked files and folders, and of the files in a folder."""
    waiting = sorted(_linked)
    done: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path in done:
            continue
        done.add(path)
        inside = _inside(path)
        waiting += [each for each in inside if _page_of(app, each) is None]
        body = _list(app, path, inside) if (ROOT / path).is_dir() else _text(app, path)
        heading = f"<h1>{html.escape(path.as_posix())}</h1>\n"
        yield _address(path).removesuffix(".html"), {"title": path.as_posix(), "body": heading + body}, "page.html"


def _inside(path: Path) -> list[Path]:
    if not (ROOT / path).is_dir():
        return []
    names = sorted((ROOT / path).iterdir())
    return [name.relative_to(ROOT) for name in names if not name.name.startswith(("_", "."))]


def _page_of(app: Sphinx, path: Path) -> str | None:
    """The address of a file that is a page of the site itself."""
    name = app.env.path2doc(ROOT / path)
    return app.builder.get_target_uri(name) if name in app.env.found_docs else None


def _list(app: Sphinx, path: Path, inside: list[Path]) -> str:
    entries = []
    for each in inside:
        to = relative_uri(_address(path), _page_of(app, each) or _address(each))
        entries.append(
            f'<li><a href="{html.escape(to)}">{html.escape(each.name)}{"/" * (ROOT / each).is_dir()}</a></li>'
        )
    return "<ul>" + "\n".join(entries) + "</ul>"


def _text(app: Sphinx, path: Path) -> str:
    """A link to the file itself, which is copied into the site, and its text in colours, where it is one."""
    copy = Path(app.outdir, FILES, path)
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(ROOT / path, copy)
    body = f'<p><a href="{html.escape(path.name)}" download>Download {html.escape(path.name)}</a></p>'
    try:
        text = (ROOT / path).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return body
    try:
        language = get_lexer_for_filename(path.name).aliases[0]
    except ClassNotFound:
        language = "text"
    assert isinstance(app.builder, StandaloneHTMLBuilder)
    return body + str(app.builder.highlighter.highlight_block(text, language, opts={}, location=path.as_posix()))


def copy_front_page(app: Sphinx, error: Exception | None) -> None:
    """The front page is where a browser looks for it, too."""
    if error is None:
        shutil.copyfile(app.outdir / "README.html", app.outdir / "index.html")


def setup(app: Sphinx) -> None:
    """Register what is added to the pages."""
    app.add_lexer("dbc", TextLexer)  # Pygments has none for it
    app.connect("source-read", add_navigation)
    app.connect("source-read", fill_from_code)
    app.connect("doctree-read", link_files, priority=100)  # before files are collected as downloads
    app.connect("html-collect-pages", pages_of_files)
    app.connect("build-finished", copy_front_page)
