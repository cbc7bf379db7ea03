"""Run what the pages report, and write it into them: python -m tools.figures [--written] [NAME ...] (`make figures`).

NAME: a writer of `WRITERS`, for example `house`; of the gallery also a scenario, `gallery/cylinder`. With `--written`
nothing is run: tables are written again from the records.
"""

from __future__ import annotations

import argparse
import sys

from tools.figures.pages import ALONE, ROOT, WRITERS, fill, writer


def main() -> None:
    """Run the writers named, or all, and fill their pages."""
    parser = argparse.ArgumentParser(prog="python -m tools.figures", description=__doc__)
    parser.add_argument("--written", action="store_true", help="run nothing, write from the records")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default: {', '.join(WRITERS)}")
    options = parser.parse_args()
    sys.path.append(str(ROOT / "tests"))  # for `support`, which the house and the lying scans share with the tests
    names = options.names or list(WRITERS)
    if unknown := [name for name in names if name.partition("/")[0] not in (*WRITERS, *ALONE)]:
        parser.error(f"no writer called {', '.join(unknown)}; there are {', '.join((*WRITERS, *ALONE))}")
    for name in names:
        module, _, part = name.partition("/")
        if not options.written:
            print(f"{name} ...", file=sys.stderr, flush=True)
            writer(module).run(*filter(None, [part]))
        fill(writer(module).texts())


if __name__ == "__main__":
    main()
