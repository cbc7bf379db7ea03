"""Page peers.md: `make peers`, which is `PYTHONPATH=tests python tools/figures/peers.py`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from inkloop.errors import InkloopError
from inkloop.files import write_text
from inkloop.fmu import describe
from inkloop.fmu_writer.export import find_fmu
from support.fmus.fmu_checkers import CHECKERS
from support.fmus.fmu_driver import FORMS, MODELS
from support.masters.loops import ONE_BLOCK, THREE_FMUS, Loop
from support.masters.other_masters import MASTERS, Master, layers_by
from support.masters.six_by_six import LAYERS, SHAPE, STEPS_S, TEXT, difference, our_run, scenario_in

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "peers.md"
HEAD = f"""# The loop in other masters

`LayerDeposition`, `ProfileSensor` and `LayerController` as FMUs, coupled by independent programs:
{SHAPE[0]} x {SHAPE[1]} cells, {LAYERS} layers, droplets that vary, noisy scans, with durations of layers and scans.
"equal" means that each layer of the print equals, bit by bit, the one of `inkloop run`; otherwise the table gives the
difference. `make peers` writes this page. `make test` also tests everything that pip alone installs, `make test-long`
Maestro and VDMCheck2 if they are installed.
"""
NOTES = f"""
- Jacobi: every component steps on the outputs of the last communication point. Gauss-Seidel: on the newest outputs,
  in the order controller, printer, profiler; fmucontainer calls it `-sequential`. Masters with one row ran their
  fixed-step algorithm.
- **FMPy, `simulate_ssp`** supports FMI 2 only and reads the text `false` of a parameter file as true: use numbers, as
  here, or the mask covers the whole grid. All connections start at zero, which does not affect this loop.
- **fmucontainer** detects that the three FMUs form a loop and reports that it starts them without each other's values.
  Version 2.0 writes wrong start values for arrays of Booleans (FMI 3): here the mask is an input of the container.
  Constant dimensions only.
- **Ecos** is wired by its Python calls: it left out the parameters that our .ssp gives the whole system. It needs
  `libtbb.so.12` (Debian: libtbb12). It reads arrays of FMI 3 as zeros without a message, hence FMI 2 only.
- **libcosim** supports FMI 2 only; the file is the one from `inkloop export-ssp --to osp`.
- **Maestro** (Java) starts from the files of `inkloop export-ssp --to maestro`. It stops at the first enumeration of a
  description, hence its FMUs declare integers; it cannot read names with a hyphen, nor arrays of FMI 3. Its
  CSV holds the shortest decimals that read back as the same number, so that no bit is lost, but does not quote names
  with commas. It takes some 45 s of processor time to prepare these 36 cells, and one second to run them.
- OMSimulator, Dymola and Simulink were not run.

The scenario:

```toml
{TEXT.strip()}
```

## The same print as one block

`LayerJob.fmu` (`inkloop export-job`) has scalar inputs and outputs only, for tools without arrays. "equal" means that
the mean height after each layer, to which every droplet adds, equals that of `inkloop run` bit by bit.
"""
BLOCK_NOTES = """
- **Ecos** omits enumerations of FMI 3, here `status`.
- **Maestro** runs nothing without a connection: here a second instance reads the outputs of the first.

## Checkers

All models in all built forms, and the block above:
"""


def outcome(master: Master, loop: Loop, fmi: str, algorithm: str, step_s: float, ours: Any) -> str:
    """ "equal", or a message with the difference."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = layers_by(master, loop, fmi, algorithm, step_s, Path(folder))
        except (InkloopError, RuntimeError, OSError, ValueError) as error:
            return f"stopped: {error}"
    return difference(found, loop.layers_of(ours)) or "equal"


def table(loop: Loop, ours: Any) -> Iterator[str]:
    """One row for each way of running a master; stderr names each as it runs, since some take minutes."""
    headings = ["master", "version", "FMI", "algorithm", "starts from", *(f"step {step_s:g} s" for step_s in STEPS_S)]
    yield f"| {' | '.join(headings)} |"
    yield "|---" * len(headings) + "|"
    for master in MASTERS:
        absent = master.program.reason_it_is_absent()
        release = "-" if absent else master.program.version
        for fmi, algorithm in master.forms_of(loop):
            print(f"{loop.name} by {master.name}, FMI {fmi}, {algorithm}", file=sys.stderr)
            found = [absent or outcome(master, loop, fmi, algorithm, step_s, ours) for step_s in STEPS_S]
            yield f"| {' | '.join([master.name, release, fmi, algorithm, master.starts_from, *found])} |"


def checks(blocks: Sequence[Path]) -> Iterator[str]:
    """One row for each checker, on the FMUs of the package and on blocks of a print."""
    for checker in CHECKERS:
        if absent := checker.program.reason_it_is_absent():
            yield f"| {checker.name} | - | - | {absent} |"
            continue
        files = [find_fmu(model, form) for form in FORMS if form[3] in checker.versions for model in MODELS]
        files += [block for block in blocks if describe(block).fmi in map(int, checker.versions)]
        faults = [f"{file.parent.name}/{file.name}: {text}" for file in files for text in checker.check(file)]
        yield f"| {checker.name} | {checker.program.version} | {len(files)} | {'<br>'.join(faults) or 'nothing'} |"


def main() -> None:
    """Run everything and write the page."""
    with tempfile.TemporaryDirectory() as folder:
        ours = our_run(Path(folder))
        blocks = [Path(folder, version, f"{ONE_BLOCK.part}.fmu") for version in ("2", "3")]
        for version in ("2", "3"):
            Path(folder, version).mkdir()
            ONE_BLOCK.system_of(scenario_in(Path(folder)), version, Path(folder, version))
        checkers = ["| checker | version | FMUs | found |", "|---|---|---|---|", *checks(blocks)]
    parts = [HEAD, *table(THREE_FMUS, ours), NOTES, *table(ONE_BLOCK, ours), BLOCK_NOTES, *checkers]
    write_text(PAGE, "\n".join(parts) + "\n")
    print(f"wrote {PAGE}", file=sys.stderr)


if __name__ == "__main__":
    main()
