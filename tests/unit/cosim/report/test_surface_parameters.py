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
    z[0, :2] = np.nan  # outside the mask
    np.save(tmp_path / "map.npy", z * 1e6)
    np.save(tmp_path / "mask.npy", mask)
    (tmp_path / "empty.npy").touch()
    command = ["metrology", str(tmp_path / "map.npy"), "--unit", "um", "--pixel-um", "10"]
    assert main([*command, "--mask", str(tmp_path / "mask.npy"), "--json", "--s-filter-um", "50"]) == 0
    shown = capsys.readouterr()
    found, expected = json.loads(shown.out), areal(map_of(z), mask > 0, s_filter=5e-5)
    assert found["Sa_um"] == pytest.approx(number(expected, "Sa") * 1e6, rel=1e-9, abs=0.0)
    assert found["Sdr"] == pytest.approx(number(expected, "Sdr"), rel=1e-9, abs=0.0)
    assert (found["cells"], found["f_operation"], found["s_filter_um"]) == (99, "plane", 50.0)
    assert found["cells_without_height"] == 0
    assert found["volume_target_nl"] is None
    assert "knows no target" in found["refused"]["volume_target"]
    for words in ("root mean square gradient", "S-filter 50 µm", "regression order 1", "least-squares plane"):
        assert words in " ".join(shown.err.split())
    for wrong, message in (
        (["--mask", "part"], "only a run knows its part"),
        (["--mask", str(tmp_path / "none.npy")], "is no mask that can be read"),
        (["--mask", str(tmp_path / "empty.npy")], "is no mask that can be read"),
        (["--layer", "1"], "leave --layer out"),
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
