"""The command lines of the pages."""

from __future__ import annotations

import re

from support.places import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
_COMMAND = re.compile(r"^    inkloop (.+)$", re.MULTILINE)
_SYNOPSIS = re.compile(r" \[--| \| ")  # it shows the form of a command
COMMANDS_BY_PAGE = {
    page.relative_to(ROOT / "docs").as_posix(): lines
    for page in PAGES
    if page.parent != ROOT
    and (lines := [line for line in _COMMAND.findall(page.read_text(encoding="utf-8")) if not _SYNOPSIS.search(line)])
}
"""Page below docs -> what follows `inkloop` in its indented lines, in their order."""
