"""Targets of the links in a folder of HTML pages."""

from __future__ import annotations

from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

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
