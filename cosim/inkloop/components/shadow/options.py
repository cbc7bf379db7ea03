"""The options of a shadow in a scenario: its own, and those of the plant that it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inkloop.component import Component, Job
from inkloop.components.plain_plant import PlainPlant
from inkloop.components.shadow.shadow import Shadow
from inkloop.contract import HEIGHT, LAYER_COMMAND, PATTERN, has_port
from inkloop.errors import FmuError
from inkloop.tables.messages import sentence
from inkloop.units import M_PER_UM

KIND = "Shadow"
_Limit = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class ShadowTable(BaseModel):
    """`[components.NAME]` with `kind = "Shadow"`; every other key is an option of the plant."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)
    plant: str = Field(default="LayerDeposition", description="kind of the deposition model")
    start: Literal["scan", "job"] = Field(
        default="scan",
        description='surface to begin on: "scan": what the scan of layer 0 finds; "job": [substrate], or a flat one',
    )
    alarm_um: _Limit = Field(default=3.0, description="rms growth divergence above which the status is untrusted")
    stop_um: _Limit | None = Field(default=None, description="rms growth divergence that ends the run")
    pattern_input: str = Field(default=PATTERN, description="of a plant without the handshake: where patterns go")
    height_output: str = Field(default=HEIGHT, description="of a plant without the handshake: its surface")


def make_shadow(
    job: Job, options: Mapping[str, object], make_plant: Callable[[str, Job, Mapping[str, object]], Component]
) -> tuple[Component | None, list[str]]:
    """A shadow, or everything wrong with its options; make_plant: `catalog.make`. Raises ScenarioError of the plant."""
    try:
        table = ShadowTable.model_validate(dict(options))
    except ValidationError as error:
        return None, [sentence(detail, ShadowTable) for detail in error.errors()]
    if table.plant == KIND:
        return None, [f"plant is {KIND!r}; expected a deposition model, such as 'LayerDeposition'"]

    def plant(job: Job) -> Component:
        made = make_plant(table.plant, job, table.model_extra or {})
        if has_port(made.inputs, LAYER_COMMAND):
            return made
        try:
            return PlainPlant(job, made, pattern_input=table.pattern_input, height_output=table.height_output)
        except ValueError:
            made.terminate()
            raise

    stop = None if table.stop_um is None else table.stop_um * M_PER_UM
    try:
        return Shadow(job, plant, start=table.start, alarm=table.alarm_um * M_PER_UM, stop=stop), []
    except FmuError as error:
        return None, [f"plant is {table.plant!r}: {error}"]
    except ValueError as error:
        return None, [str(error)]
