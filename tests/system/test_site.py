"""The pages as a site: built without a warning, no dead link, nothing from a network, no message of a browser."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from support.browser import browser, needs_chromium
from support.places import ROOT

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not all(map(find_spec, ("sphinx", "myst_nb", "furo"))), reason="needs Sphinx: pip install 'inkloop[site]'"
    ),
]


LINKS = ("href", "src", "srcset", "poster", "data")


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.anchors = {"", "top"}
        self.targets: list[tuple[str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            if name in LINKS and value is not None:
                self.targets.append((tag, value))


@dataclass
class SiteLinks:
    """Links of a site: `dead` lead to no file or no anchor, `loaded` come from a network when a page is opened."""

    dead: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)
    within: int = 0


def read_links(site: Path) -> SiteLinks:
    """All links of all pages below a folder. Links that a reader must click to leave the site are not followed."""
    pages: dict[Path, _Page] = {}
    for path in sorted(site.resolve().rglob("*.html")):
        pages[path] = _Page()
        pages[path].feed(path.read_text(encoding="utf-8"))
    links = SiteLinks()
    for path, page in pages.items():
        for tag, target in page.targets:
            parts = urlsplit(target)
            if parts.scheme == "data":
                continue
            if parts.scheme or parts.netloc:
                links.loaded += [f"{path.name}: {target}"] * (tag != "a")
                continue
            links.within += 1
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = pages[file].anchors if file in pages else {""}
            if not file.is_file() or unquote(parts.fragment) not in anchors:
                links.dead.append(f"{path.relative_to(site.resolve())}: {target}")
    return links


def build(site: Path, root: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs what `make site` runs, into another folder."""
    recipe = re.search(r"^site:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert recipe is not None
    (command,) = re.findall(r"-m sphinx (.*?)\n\t@", recipe[1].replace("\\\n", " "), re.DOTALL)
    words = command.replace("build/site-doctrees", f"{site}-doctrees").replace("build/site", str(site)).split()
    return subprocess.run(
        [sys.executable, "-m", "sphinx", *words],
        cwd=root,
        env={**os.environ, "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("built") / "site"
    run = build(folder)
    assert (run.returncode, run.stderr) == (0, "")
    return folder


def address(page: Path) -> Path:
    return page.relative_to(ROOT).with_suffix(".html")


def test_every_page_is_in_the_site_and_in_its_navigation(site: Path) -> None:
    pages = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("docs/notebooks/*.ipynb"), *ROOT.glob("fmus/*/readme.md")]
    assert len(pages) > 40
    front = (site / "index.html").read_text(encoding="utf-8")
    for page in map(address, pages):
        assert (site / page).is_file()
        assert f'href="{page.as_posix()}"' in front


def test_no_link_within_the_site_is_dead(site: Path) -> None:
    links = read_links(site)
    assert links.within > 5000
    assert links.dead == []


def test_no_page_loads_anything_from_a_network(site: Path) -> None:
    assert read_links(site).loaded == []
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*[\"']?(https?:)?//", sheet.read_text(encoding="utf-8")), sheet


def test_scenario_is_shown_and_can_be_downloaded(site: Path) -> None:
    gallery = (site / "docs/gallery/README.html").read_text(encoding="utf-8")
    assert 'href="../../files/scenarios/cylinder.toml.html"' in gallery
    assert 'href="cylinder.toml" download' in (site / "files/scenarios/cylinder.toml.html").read_text(encoding="utf-8")
    assert (site / "files/scenarios/cylinder.toml").read_bytes() == (ROOT / "scenarios/cylinder.toml").read_bytes()


def test_check_of_links_finds_a_dead_link_and_a_dead_anchor(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<h1 id="here"></h1><a href="b.html"></a><a href="#there"></a><a href="#here"></a>'
    )
    (tmp_path / "c.html").write_text('<a href="a.html#gone"></a><script src="https://example.org/a.js"></script>')
    links = read_links(tmp_path)
    assert links.dead == ["a.html: b.html", "a.html: #there", "c.html: a.html#gone"]
    assert links.loaded == ["c.html: https://example.org/a.js"]


MUTATIONS = (
    ("docs/tutorial/first-print.md", "../gallery/README.md", "../gallery/no-page.md"),
    (
        "docs/how-to/sweep-settings.md",
        "../../scenarios/studies/which-settings-matter.toml",
        "../../scenarios/no-file.toml",
    ),
    ("docs/reference/score-board.md", "../../lab/inkloop_lab/score/plant-v2", "../../lab/no-folder"),
    ("README.md", "the-layer-problem.md#what-the-horizon-buys", "the-layer-problem.md#no-heading"),
)


def test_build_fails_at_each_mutated_link_and_names_its_page(tmp_path: Path) -> None:
    root = tmp_path / "root"
    left_out = (".*", "build", "dist", "runs", "__pycache__")
    shutil.copytree(ROOT, root, ignore=shutil.ignore_patterns(*left_out))
    for page, before, after in MUTATIONS:
        text = (root / page).read_text(encoding="utf-8")
        assert text.count(before) == 1, page
        (root / page).write_text(text.replace(before, after), encoding="utf-8")
    run = build(tmp_path / "site", root)
    assert run.returncode != 0
    assert run.stderr.count("WARNING") == len(MUTATIONS), run.stderr
    for page, _, after in MUTATIONS:
        target = after.rpartition("#")[2]
        assert re.search(rf"{re.escape(page)}:\d+: WARNING: .*{re.escape(target)}", run.stderr), run.stderr


@needs_chromium
@pytest.mark.parametrize(
    "page", ["index.html", "docs/reference/metrology.html", "docs/gallery/README.html", "docs/notebooks/own-plant.html"]
)
def test_page_opens_without_a_message_of_the_browser(site: Path, page: str) -> None:
    with browser() as tab:
        tab.open((site / page).as_uri())
        tab.wait("document.readyState === 'complete' && location.protocol === 'file:'")
        assert tab.value("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
        assert tab.messages == []


@needs_chromium
def test_search_finds_a_page_without_a_network(site: Path) -> None:
    with browser() as tab:
        tab.open((site / "search.html").as_uri() + "?q=autocorrelation")
        tab.wait("document.querySelectorAll('#search-results li a').length > 0")
        found = tab.value("[...document.querySelectorAll('#search-results li a')].map((link) => link.href)")
        assert any("docs/reference/metrology.html" in link for link in found)
        assert tab.messages == []
