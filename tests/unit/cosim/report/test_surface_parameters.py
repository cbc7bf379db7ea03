"""`inkloop metrology` shows what the evaluation gives, under the mask and with the filters that it names."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from inkloop.cli import main
from support.evaluated import areal, map_of, number, rough


def test_the_command_evaluates_a_map_under_a_mask(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    z, mask = rough(), np.zeros((24, 17), np.uint8)
    mask[4:15, 3:12] = 1
    mask[4:15, 3] = 255
    z[0, :2] = np.nan  # outside the mask
    np.save(tmp_path / "map.npy", z * 1e6)
    np.save(tmp_path / "mask.npy", mask)
    np.save(tmp_path / "heights.npy", z)
    (tmp_path / "empty.npy").touch()
    command = ["metrology", str(tmp_path / "map.npy"), "--unit", "um", "--pixel-um", "10"]
    assert main([*command, "--mask", str(tmp_path / "mask.npy"), "--json", "--s-filter-um", "50"]) == 0
    shown = capsys.readouterr()
    found, expected = json.loads(shown.out), areal(map_of(z), mask > 0, s_filter=5e-5)
    assert found["Sa_um"] == pytest.approx(number(expected, "Sa") * 1e6, rel=1e-9, abs=0.0)
    assert found["Sdr"] == pytest.approx(number(expected, "Sdr"), rel=1e-9, abs=0.0)
    assert (found["cells"], found["f_operation"], found["s_filter_um"]) == (99, "plane", 50.0)
    assert found["cells_without_height"] == 0
    assert "step_height_ls" in found["refused"], "a mask is a part"
    assert not {"volume_target_nl", "droplets"} & found.keys(), "a map knows neither target nor droplets"
    assert "24 x 17 pixels of 10 x 10 µm, a field of 240 x 170 µm, heights from" in shown.err.splitlines()[0]
    assert found["surface"].endswith("stored in um")
    for words in ("root mean square gradient", "S-filter 50 µm", "regression order 1", "least-squares plane"):
        assert words in " ".join(shown.err.split())
    assert main([*command, "--json", "--s-filter-um", "50", "--filter-order", "0"]) == 0
    sq = [number(areal(map_of(z), s_filter=5e-5, filter_order=order), "Sq") * 1e6 for order in (0, 1)]
    assert json.loads(capsys.readouterr().out)["Sq_um"] == pytest.approx(sq[0], rel=1e-9, abs=0.0)
    assert sq[0] != pytest.approx(sq[1], rel=1e-4, abs=0.0)
    for wrong, message in (
        (["--mask", "part"], "only a run knows its part"),
        (["--mask", str(tmp_path / "none.npy")], "is no mask that can be read"),
        (["--mask", str(tmp_path / "empty.npy")], "is no mask that can be read"),
        (["--mask", str(tmp_path / "heights.npy")], "holds no mask; expected an array of booleans"),
        (["--layer", "1"], "leave --layer out"),
        (["--missing", "40"], "--missing is 40; expected a share from 0 to 1"),
        (["--channel", "Height"], "channel (--channel) is 'Height'; expected one of 1 'the array'"),
        (["--l-filter-um", "-3"], "--l-filter-um is -3; expected a length above 0"),
    ):
        assert main([*command, *wrong]) == 1
        assert message in capsys.readouterr().err


def test_the_command_evaluates_the_counts_of_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    counts = np.arange(1, 241, dtype=np.uint8).reshape(15, 16)
    counts[3, 4] = 255
    Image.fromarray(counts).save(tmp_path / "map.png")
    command = ["metrology", str(tmp_path / "map.png"), "--unit", "um", "--pixel-um", "10", "--f-operation", "none"]
    assert main([*command, "--json"]) == 1
    assert "give count_scale" in capsys.readouterr().err
    assert main([*command, "--json", "--count-scale", "0.5", "--invalid-value", "255"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["cells"] == 239
    assert found["Sz_um"] == pytest.approx(0.5 * 239, rel=1e-9, abs=0.0)


def test_the_command_evaluates_profiles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "map.npy", rough((60, 17)))
    command = ["metrology", str(tmp_path / "map.npy"), "--unit", "m", "--pixel-um", "10", "--json", "--profile", "x"]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["profiles"] == "17 of 17 rows along x, evaluation length 600 µm, primary profiles"
    assert found["Pt_um"] > found["Pp_um"] > found["Pq_um"] > found["Pa_um"] > 0.0
    assert main([*command, "--l-filter-um", "700"]) == 1
    assert json.loads(capsys.readouterr().out)["refused"]["Ra"].startswith("a filter of 700 µm is wider than")


def test_a_map_that_is_no_part_has_rows_of_its_surface_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "map.npy", rough((60, 17)))
    assert main(["metrology", str(tmp_path / "map.npy"), "--unit", "m", "--pixel-um", "10", "--json"]) == 0
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    assert {"Sa_um", "flatness_mz_um"} <= found.keys()
    assert not [key for key in found if key.startswith(("parallelism", "step", "wall", "radius", "volume", "droplet"))]
    assert not [line for line in shown.err.splitlines() if line.endswith(" -")]


def test_too_many_holes_are_the_first_thing_said_and_may_be_allowed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    z = rough((60, 17))
    z[:20] = np.nan
    np.save(tmp_path / "map.npy", z)
    command = ["metrology", str(tmp_path / "map.npy"), "--unit", "m", "--pixel-um", "10"]
    assert main(command) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "600 x 170 µm, heights from" in lines[0]
    assert lines[1].startswith("340 of 1020 cells (33%) have no height; at most 20% may lack one: ")
    assert lines[1].endswith("`inkloop metrology --missing`: no parameter")
    assert len(lines) == 2
    assert main([*command, "--missing", "0.4", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["Sz_um"] > 0.0
    assert (found["missing"], found["cells_without_height"]) == (0.4, 340)


def test_the_command_evaluates_a_file_with_one_profile(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{k * 0.001:.3f}; {2 * np.sin(2 * np.pi * k / 40):.6f}\n" for k in range(400)]
    (tmp_path / "line.txt").write_text("x [mm]; z [um]\n" + "".join(rows))
    command = ["metrology", str(tmp_path / "line.txt"), "--json"]
    assert main(command) == 1
    assert "holds a profile of 400 heights and no map; `inkloop metrology --profile`" in capsys.readouterr().err
    assert main([*command, "--profile", "--f-operation", "none"]) == 0
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    assert (found["Pa_um"], found["Psm_um"]) == pytest.approx((4 / np.pi, 40.0), rel=5e-3, abs=0.0)
    assert "a profile of 400 points, 1 µm apart, 400 µm long" in shown.err.splitlines()[0]
    assert main([*command, "--profile", "--l-filter-um", "70"]) == 0
    assert json.loads(capsys.readouterr().out)["profiles"].endswith("350 µm, 5 section lengths")


def test_unequal_sides_of_pixels_take_no_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, sizes in (("x", (1e4, 0.1)), ("y", (0.1, 1e4))):
        z = rough((40, 30)) if name == "y" else rough((30, 40)).T.reshape(30, 40)
        np.savez(tmp_path / f"{name}.npz", z_m=z[:9], dx_um=sizes[0], dy_um=sizes[1])
        assert main(["metrology", str(tmp_path / f"{name}.npz"), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["Sa_um"] > 0.0
