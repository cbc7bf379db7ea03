"""Parts from files print like the formulas that they are made from."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tools import parts

from inkloop.cli import main
from inkloop.geometry import Columns, Cuboid
from inkloop.printing.run import print_part
from inkloop.results.solid import region_edges
from inkloop.scenario.file import Scenario
from support.places import SCENARIOS

NEEDS_3MF = pytest.mark.skipif(find_spec("lib3mf") is None, reason="3MF needs lib3mf: pip install 'inkloop[3mf]'")
CELLS, MARGIN, PITCH_MM = 24, 2, 0.263256
PITCH_M = PITCH_MM * 1e3 * 1e-6  # as a scenario has it
OUTER, INNER = (5.3 * PITCH_MM, 0.05), (3.2 * PITCH_MM, 0.029)
"""Half-axes of the pipes, across and upright [mm]; the outer ones reach the top, as the block then does."""
HEIGHT_MM = 0.1
SUPPORT = "[support]\nmargin_cells = 2\n"
TAIL = """
[ink.b]
h1_um = 3.9
h2_um = 0.55
h3_um = 0.15
[components.controller]
kind = "LayerMpc"
horizon = 2
[components.printer]
kind = "LayerDeposition"
variation = 0.2
variation_kind = "per_droplet"
[components.profiler]
kind = "ProfileSensor"
preset = "exact"
"""
HEAD = f'title = "Pipes"\nseed = 3\ngrid = {{ nx = {CELLS}, ny = {CELLS}, pitch_um = {PITCH_MM * 1e3} }}\n[part]\n'
FORMULA = f"""shape = "pipe-junction"
outer_across_um = {OUTER[0] * 1e3}
outer_upright_um = {OUTER[1] * 1e3}
inner_across_um = {INNER[0] * 1e3}
inner_upright_um = {INNER[1] * 1e3}
height_um = {HEIGHT_MM * 1e3}
"""


def pipe(half_axes: tuple[float, float], along: int) -> parts.Triangles:
    """An elliptic bar through the block, along x or y, in coordinates of the grid."""
    angle = np.arange(512) / 512 * 2 * np.pi
    outline = list(zip(half_axes[0] * np.cos(angle), half_axes[1] * np.sin(angle), strict=True))
    bar = parts.prism(outline, (MARGIN - 0.5) * PITCH_MM, (CELLS - MARGIN - 0.5) * PITCH_MM)
    middle = (CELLS - 1) / 2 * PITCH_MM
    across, upright, run = bar[..., 0] + middle, bar[..., 1] + HEIGHT_MM / 2, bar[..., 2]
    placed = np.stack([run, across, upright] if along == 0 else [across, run, upright], axis=-1)
    return placed if along == 0 else placed[:, ::-1]


def loaded(folder: Path, part: str) -> Scenario:
    (folder / "pipes.toml").write_text(HEAD + part + TAIL)
    return Scenario.load(folder / "pipes.toml")


def test_pipe_junction_cut_out_of_meshes_is_that_of_the_formula(tmp_path: Path) -> None:
    """But for facets, which take 2 nm from a wall of 21 um."""
    for name, half_axes in (("outer", OUTER), ("inner", INNER)):
        bars = [pipe(half_axes, along) for along in (0, 1)]
        (tmp_path / f"{name}.stl").write_bytes(parts.stl(np.concatenate(bars)))
    meshes = ", ".join(
        f'{{ shape = "mesh", file = "{name}.stl", unit = "mm", place = "as-is" }}' for name in ("outer", "inner")
    )
    combined = f'shape = "combine"\nop = "difference"\nparts = [{meshes}]\n'
    formula, cut = (loaded(tmp_path, part + SUPPORT).solid for part in (FORMULA, combined))
    middle, edge = (CELLS - 1) / 2 * PITCH_M, (CELLS - 2 * MARGIN) * PITCH_M
    block = Cuboid(middle, middle, edge, edge, 1e-3)
    inside = Columns.of_shape(block, CELLS, CELLS, PITCH_M)
    one, other = (solid.columns(CELLS, CELLS, PITCH_M) & inside for solid in (formula, cut))
    assert ((one - other).volume + (other - one).volume) / one.volume < 1e-3


@NEEDS_3MF
def test_pipe_junction_of_a_3mf_is_the_job_of_the_formula(tmp_path: Path) -> None:
    """But for facets, which take 0.1 um from an edge of the walls."""
    junction = parts.pipe_junction(OUTER, INNER, (CELLS - 2 * MARGIN) * PITCH_MM, HEIGHT_MM)
    parts.write_three_mf(tmp_path / "pipes.3mf", junction)
    in_inks = 'shape = "mesh"\nfile = "pipes.3mf"\n[part.inks]\nwalls = "A"\nsupport = "B"\n'
    formula, mesh = (loaded(tmp_path, part).job() for part in (FORMULA + SUPPORT, in_inks))
    np.testing.assert_array_equal(mesh.mask, formula.mask)
    np.testing.assert_allclose(mesh.target_height, formula.target_height, rtol=0.0, atol=1e-11)
    for name, edges in region_edges(formula).items():
        np.testing.assert_allclose(
            region_edges(mesh)[name][:, mesh.mask], edges[:, formula.mask], rtol=0.0, atol=0.11e-6, err_msg=name
        )


@NEEDS_3MF
@pytest.mark.long
def test_pipe_junction_of_a_3mf_has_the_mismatch_of_the_formula() -> None:
    mesh = Scenario.load(SCENARIOS / "pipe-junction-3mf.toml")
    halves = {f"part.{name}_across_um": parts.PIPES[n][0] * 1e3 for n, name in enumerate(("outer", "inner"))}
    formula = Scenario.load(SCENARIOS / "pipe-junction.toml", {"grid.nx": 50, "grid.ny": 50, **halves})
    mismatch = [print_part(scenario).metrics()["mismatch"] for scenario in (formula, mesh)]
    assert mismatch[0] < 0.2
    assert mismatch[1] == pytest.approx(mismatch[0], abs=0.002)


def test_run_whose_part_was_changed_is_not_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh, folder = tmp_path / "part.stl", tmp_path / "run"
    mesh.write_bytes(parts.stl(parts.box((0.0, 0.6), (0.0, 0.4), 0.0, 0.02)))
    assert main(["new", str(tmp_path / "mine"), "--part", str(mesh), "--pitch-um", "100"]) == 0
    few = ["--set", "run.layers_max=2", "--set", "compare={}", "--no-pictures"]
    assert main(["run", str(tmp_path / "mine.toml"), *few, "--out", str(folder)]) == 0
    record = folder / "run.json"
    record.write_text(record.read_text().replace('"stop_reason": "layers_max"', '"stop_reason": "interrupted"'))
    mesh.write_bytes(parts.stl(parts.box((0.0, 0.6), (0.0, 0.5), 0.0, 0.02)))
    assert main(["resume", str(folder), "--no-pictures"]) == 1
    assert "the files of its part were changed since the run began" in capsys.readouterr().err
