"""Instruments by name: values of a model's parameters that belong together, in SI.

A preset is chosen with `preset = "laser"` in a component's table; other values of the table override it.
"""

from __future__ import annotations

from collections.abc import Mapping

PRESETS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "ProfileSensor": {
        # line laser of Lu, Zheng, Mishra 2015, Fig. 17; repeatability taken as the standard deviation of a reading
        "laser": {"noise_std": 1e-6, "resolution": 0.1e-6, "scan_duration": 6.0},
        # optical profilometer of Wu, Chiu 2024: resolution along z; its noise is not given, the duration assumed
        "zeta-20": {"resolution": 0.04e-6, "scan_duration": 6.0},
        "exact": {"scan_duration": 0.0},
    }
}
"""Model -> preset -> parameter -> value; what is not named keeps the model's default."""


def preset_of(model: str, name: object) -> tuple[Mapping[str, float], list[str]]:
    """Values of a model's preset (none without a name), and the error of a wrong name."""
    presets = PRESETS.get(model, {})
    if name is None:
        return {}, []
    if not presets:
        return {}, [f"preset is {name!r}; {model} has no presets"]
    if not isinstance(name, str) or name not in presets:
        return {}, [f"preset is {name!r}; expected one of {', '.join(presets)}"]
    return presets[name], []
