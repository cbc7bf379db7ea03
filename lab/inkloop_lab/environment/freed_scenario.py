"""A scenario without its controller, whose actions come from outside, and the spaces of Gymnasium for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from inkloop.components import catalog, devices
from inkloop.contract import LAYER_COMMAND, MEASURED_HEIGHT, VALID, has_port
from inkloop.errors import ScenarioError
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from
from inkloop_lab.policies import MASK, TARGET, ActionCode, free_seat

FREE = f"{free_seat.__module__}:{free_seat.__name__}"
HEIGHT_MAX_M = 1.0
"""Bound of heights, above any print (assumed)."""
_UNUSED = ("compare", "literature", "metrology")


@dataclass(frozen=True)
class FreedScenario:
    """own: the scenario with its controller; name: of that component; text: without it; drop_levels: drops at most."""

    own: Scenario
    name: str
    text: str
    drop_levels: int

    @classmethod
    def of(
        cls, scenario: Scenario | Path | str, overrides: Mapping[str, Any], drop_levels: int | None
    ) -> FreedScenario:
        """drop_levels: None: as the controller's option. Raises ScenarioError without a controller, or with devices."""
        own = _loaded(scenario, overrides)
        kinds = {name: table.kind for name, table in own.tables.components.items()}
        errors = [
            f"components.{name}.kind is {kind!r}, no model; LayerEnv needs a model in its place"
            for name, kind in kinds.items()
            if kind in devices.KINDS or kind in (catalog.MAPPED, catalog.MAP_FOLDER)
        ]
        name = next((name for name, ports in own.ports.items() if has_port(ports.outputs, LAYER_COMMAND)), "")
        if not name:
            errors.append("components: none commands layers; LayerEnv needs a controller whose place it takes")
        if errors:
            raise ScenarioError(own.source, errors)
        given = own.tables.components[name].options.get("drop_levels", 1) if drop_levels is None else drop_levels
        document = tomlkit.parse(own.text)
        for table in _UNUSED:
            document.pop(table, None)
        document["components"][name] = {"kind": FREE, "drop_levels": given}
        return cls(own, name, tomlkit.dumps(document), int(given))

    @property
    def folder(self) -> Path:
        """Folder of the scenario and of its classes."""
        return Path(self.own.source).parent

    def seeded(self, seed: int) -> Scenario:
        """The scenario with this seed and without controller. Raises ScenarioError."""
        with classes_from(self.folder):
            return Scenario.of_text(self.text, self.own.source, {"seed": seed})


def _loaded(scenario: Scenario | Path | str, overrides: Mapping[str, Any]) -> Scenario:
    if isinstance(scenario, Scenario):
        return Scenario.of_text(scenario.text, scenario.source, overrides) if overrides else scenario
    with classes_from(Path(scenario).parent):
        return Scenario.load(scenario, overrides)


def spaces(code: ActionCode) -> tuple[Any, Any]:
    """Of observations, and of actions: a bit for each cell if the only choice is a droplet or none."""
    from gymnasium.spaces import Box, Dict, MultiBinary, MultiDiscrete

    heights, marks = Box(-HEIGHT_MAX_M, HEIGHT_MAX_M, code.shape, np.float64), MultiBinary(code.shape)
    actions = MultiBinary(code.shape) if code.values == 2 else MultiDiscrete(np.full(code.shape, code.values))
    return Dict({MEASURED_HEIGHT: heights, VALID: marks, TARGET: heights, MASK: marks}), actions
