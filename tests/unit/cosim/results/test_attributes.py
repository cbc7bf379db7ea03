"""Every variable of `result.nc` says what it is: CF attributes that fit the values, and the codes of their sources."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from inkloop.components.shadow import shadow_ports
from inkloop.contract import COUNTERS, STATUS
from inkloop.results.attributes import MEANINGS, variable
from inkloop.results.recorder import COUNTER_ROLES
from inkloop.testing import job
from inkloop_controller import PlanStatus
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.estimate_figures import TRANSFORMS, UntrustedReason
from inkloop_controller.planning.layer_plan import LeftOut
from support.places import ROOT
from support.toys import toy_result


def spelled(words: Iterable[str]) -> str:
    return " ".join(word.replace(" ", "_") for word in words)


def test_codes_and_limits_have_the_type_of_the_values_in_the_file(tmp_path: Path) -> None:
    toy_result().save(tmp_path)
    coded = set()
    with h5netcdf.File(tmp_path / "result.nc") as stored:
        assert stored.attrs["Conventions"].startswith("CF-1.")
        for name, array in stored.variables.items():
            assert array.attrs["units"], name
            assert len(str(array.attrs["long_name"]).split()) > 1, name
            for key in {"flag_values", "flag_masks", "valid_range", "valid_min"} & set(array.attrs):
                values = np.asarray(array.attrs[key])
                assert values.dtype == array.dtype, (name, key)
                if key.startswith("flag"):
                    coded.add(name)
                    assert len(str(array.attrs["flag_meanings"]).split()) == values.size, name
                    assert not np.setdiff1d(array[...], values).size, name
    assert coded >= {"mask", "pattern", "valid"}


def test_long_names_differ_and_those_of_errors_say_their_sign() -> None:
    for sign in ("target minus height", "too low", "too high"):
        assert sign in MEANINGS["mean_error"].long_name
    for name in ("mae", "rms", "std"):
        assert "target minus height" in MEANINGS[name].long_name
    assert len({meaning.long_name for meaning in MEANINGS.values()}) == len(MEANINGS)


def test_codes_are_those_of_the_parts_that_put_them_out() -> None:
    assert spelled(MEANINGS["plan_status"].flags) == spelled(status.value for status in PlanStatus)
    assert MEANINGS["modified"].flags == ("no", "yes")
    assert MEANINGS["pattern"].flags == MEANINGS["ink"].flags == ("none", "ink_a", "ink_b")
    assert MEANINGS["valid"].flags == ("not_measured", "measured")
    assert spelled(MEANINGS["shadow_status"].flags) == "idle busy done fault untrusted"
    bits = [1 << bit for bit in range(len(MEANINGS["untrusted_reasons"].masks))]
    assert bits == [reason.value for reason in UntrustedReason]
    assert MEANINGS["stop_reason"].masks == MEANINGS["untrusted_reasons"].masks
    assert spelled(MEANINGS["stop_transform"].flags[2:]) == spelled(TRANSFORMS[2:])
    assert spelled(MEANINGS["left_out"].masks) == spelled(str(stage.name).lower() for stage in LeftOut)
    assert [stage.value for stage in LeftOut] == [1 << bit for bit in range(len(LeftOut))]


def test_every_output_of_our_models_and_controllers_has_a_meaning() -> None:
    outputs = {port.name for port in (*LayerMpcController(job()).outputs, *shadow_ports((), (2, 2))[1])}
    for path in ROOT.glob("fmus/*_deposition/variables.toml"):
        variables = tomllib.loads(path.read_text(encoding="utf-8"))["variables"]
        outputs |= {name for name, about in variables.items() if about["causality"] == "output"}
    assert len(outputs) > 20
    assert not outputs - {STATUS, *COUNTERS, *COUNTER_ROLES} - set(MEANINGS)


def test_attributes_are_those_of_the_conventions() -> None:
    def found(name: str, value: Any, unit: str = "1") -> dict[str, Any]:
        return dict(variable(name, (), value, unit).attrs)

    assert found("x", 1.0, "m")["axis"] == "X"
    assert found("y", 1.0, "m")["axis"] == "Y"
    mask = found("mask", np.True_)
    assert mask["flag_values"].tolist() == [0, 1]
    assert (mask["flag_values"].dtype, mask["flag_meanings"], mask["units"]) == (np.int8, "outside part", "1")
    reasons = found("untrusted_reasons", np.int32(3))
    assert reasons["flag_masks"].tolist() == [1 << bit for bit in range(11)]
    assert reasons["flag_meanings"].split()[:2] == ["unseen_cells", "blind_scans"]
    assert found("area", np.float32(0.5))["valid_range"].tolist() == [0.0, 1.0]
    droplets = found("droplets_a", np.int32(5))
    assert (droplets["valid_min"], droplets["valid_min"].dtype) == (0, np.int32)
    assert "valid_range" not in droplets
    assert "valid_min" not in found("mean_error", 1.0, "m")
    assert found("rms", 1.0, "m")["cell_methods"] == "area: root_mean_square (comment: over the cells of the part)"
    assert found("valid", np.True_)["standard_name"] == "quality_flag"
    assert found("measured_height", 1.0, "m")["ancillary_variables"] == "valid"
    assert "flag_values" not in found("plan_status", 1.0)  # codes that are no whole numbers
    assert found("wet_share", 1.0)["long_name"] == "wet share"
    assert variable("wetness", (), 1.0, "1", giver="printer").attrs["long_name"] == "output wetness of the printer"
