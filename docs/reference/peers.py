"""Page peers.md: `make peers`, which is `PYTHONPATH=tests python docs/reference/peers.py`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from contract.fmu_driver import FORMS, MODELS
from fmu_checkers import CHECKERS
from inkloop.errors import InkloopError
from inkloop.export import find_fmu
from inkloop.files import write_text
from other_masters import MASTERS, Master, layers_by
from six_by_six import LAYERS, SHAPE, STEPS_S, TEXT, difference, our_layers

PAGE = Path(__file__).with_name("peers.md")
HEAD = f"""# The loop in masters of others

`LayerDeposition`, `ProfileSensor` and `LayerController` as FMUs, coupled by programs of other people: {SHAPE[0]} x
{SHAPE[1]} cells, {LAYERS} layers, droplets that vary, noisy scans, both of which take time. "equal" means that each
layer of the print is, bit by bit, the one of `inkloop run`. What differs is said. `make peers` writes this page;
what pip alone installs is tested by `make test` too.

"""
NOTES = f"""
- Jacobi: every part steps on what the others gave at the last communication point. Gauss-Seidel: on what they gave
  last, in the order controller, printer, profiler; fmucontainer calls it `-sequential`. What has
  one row was run by its fixed-step algorithm.
- **FMPy, `simulate_ssp`** takes FMI 2 only and reads the text `false` of a parameter file as true: hand it numbers, as
  here, or the mask covers the whole grid. It begins with zeros on all connections, which this loop does not mind.
- **fmucontainer** sees that the three FMUs stand in a loop and says that it starts them without each other's values.
  Version 2.0 writes start values of an array of Booleans wrongly (FMI 3): the mask goes in from outside, as an
  input of the container. Constant dimensions only.
- **Ecos** is wired by its Python calls: it left out the parameters that our .ssp gives the whole system. It needs
  `libtbb.so.12` (Debian: libtbb12). It reads arrays of FMI 3 as zeros without saying so, hence FMI 2 only.
- **libcosim** takes FMI 2 only; the file is the one of `inkloop export-ssp --to osp`.
- **Maestro** (Java) starts from the files of `inkloop export-ssp --to maestro`. It stops at the first enumeration of a
  description, hence the FMUs there declare integers; names with a hyphen it cannot read. Its CSV prints the shortest
  decimals that read back as the same number, so that no bit is lost, but does not quote names with commas. It takes
  some 45 s of processor time to prepare these 36 cells, and one second to run them. Arrays of FMI 3 it does not know.
- OMSimulator, Dymola and Simulink were not run.

The scenario:

```toml
{TEXT.strip()}
```

## Checkers

"""


def outcome(master: Master, fmi: str, algorithm: str, step_s: float, ours: Any) -> str:
    """ "equal", or what differs, in words."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = layers_by(master, fmi, algorithm, step_s, Path(folder))
        except (InkloopError, RuntimeError, OSError, ValueError) as error:
            return f"stopped: {error}"
    return difference(found, ours) or "equal"


def rows(ours: Any) -> Iterator[str]:
    """One row of the table for each way of running a master."""
    for master in MASTERS:
        absent = master.program.reason_it_is_absent()
        for fmi, algorithm in master.forms:
            found = [absent or outcome(master, fmi, algorithm, step_s, ours) for step_s in STEPS_S]
            release = "-" if absent else master.program.version
            yield " | ".join(["", master.name, release, fmi, algorithm, master.starts_from, *found, ""]).strip()


def checks() -> Iterator[str]:
    """One row for each checker."""
    for checker in CHECKERS:
        if absent := checker.program.reason_it_is_absent():
            yield f"| {checker.name} | - | - | {absent} |"
            continue
        files = [find_fmu(model, form) for form in FORMS if form[3] in checker.versions for model in MODELS]
        faults = [f"{file.parent.name}/{file.name}: {text}" for file in files for text in checker.check(file)]
        yield f"| {checker.name} | {checker.program.version} | {len(files)} | {'<br>'.join(faults) or 'nothing'} |"


def main() -> None:
    """Run everything and write the page."""
    with tempfile.TemporaryDirectory() as folder:
        ours = our_layers(Path(folder))
    headings = ["master", "version", "FMI", "algorithm", "starts from", *(f"step {step_s:g} s" for step_s in STEPS_S)]
    table = [f"| {' | '.join(headings)} |", "|---" * len(headings) + "|", *rows(ours)]
    models = ["| checker | version | FMUs of the package | found |", "|---|---|---|---|", *checks()]
    write_text(PAGE, HEAD + "\n".join(table) + "\n" + NOTES + "\n".join(models) + "\n")
    print(f"wrote {PAGE}", file=sys.stderr)


if __name__ == "__main__":
    main()
