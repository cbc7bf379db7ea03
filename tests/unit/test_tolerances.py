"""Every comparison of numbers names its tolerance: 1e-12 is nothing in um, and all of a droplet in m3."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from support.places import ROOT
from support.source_tree import parsed

BY_DEFAULT = ("isclose", "allclose")  # math.isclose and NumPy's, with atol = 1e-8


def calls(*names: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Place and named arguments of every call of these functions in the tests."""
    for path in sorted((ROOT / "tests").rglob("*.py")):
        if not any(name in path.read_text(encoding="utf-8") for name in names):
            continue
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in names:
                place = f"{path.relative_to(ROOT)}:{node.lineno}"
                yield place, {word.arg or "": ast.unparse(word.value) for word in node.keywords}


def test_approx_names_its_absolute_tolerance() -> None:
    """Its own one is 1e-12. With abs = 0.0 alone it compares bits, so rel is named too."""
    found = list(calls("approx"))
    assert len(found) > 200
    assert not [place for place, named in found if "abs" not in named]
    assert not [place for place, named in found if named["abs"] == "0.0" and "rel" not in named]


def test_numbers_are_not_compared_with_the_tolerance_of_a_library() -> None:
    assert not [place for place, named in calls(*BY_DEFAULT) if not {"atol", "abs_tol"} & set(named)]
