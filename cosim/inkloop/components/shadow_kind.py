"""The options of a shadow in a scenario: its own, and those of the plant that it runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inkloop.component import Component, Job, Ports
from inkloop.components.followed_plant import checked_inputs
from inkloop.components.kind import Bench, Check, Checked
from inkloop.components.plain_plant import PlainPlant, wrapped_ports
from inkloop.components.shadow import Shadow, shadow_ports
from inkloop.contract import HEIGHT, LAYER_COMMAND, PATTERN, has_port
from inkloop.tables.messages import sentence
from inkloop.units import M_PER_UM

KIND = "Shadow"
_Limit = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class ShadowTable(BaseModel):
    """`[components.NAME]` with `kind = "Shadow"`; every other key is an option of the plant."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, defer_build=True)
    plant: str = Field(default="LayerDeposition", description="kind of the deposition model")
    start: Literal["scan", "job"] = Field(
        default="scan",
        description='surface to begin on: "scan": what the scan of layer 0 finds; "job": `[substrate]`, or a flat one',
    )
    alarm_um: _Limit = Field(default=3.0, description="rms growth divergence above which the status is untrusted")
    stop_um: _Limit | None = Field(default=None, description="rms growth divergence that ends the run")
    pattern_input: str = Field(default=PATTERN, description="of a plant without the handshake: where patterns go")
    height_output: str = Field(default=HEIGHT, description="of a plant without the handshake: its surface")


class ShadowKind:
    """The kind of a `Shadow`."""

    path_option: ClassVar[str | None] = "file"

    def __init__(self, check: Check) -> None:
        self._check = check

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check the shadow's own options, those of its plant, then whether the plant can be followed."""
        try:
            table = ShadowTable.model_validate(dict(options))
        except ValidationError as error:
            return Checked(KIND, [sentence(detail, ShadowTable) for detail in error.errors()])
        if table.plant == KIND:
            return Checked(KIND, [f"plant is {KIND!r}; expected a deposition model, such as 'LayerDeposition'"])
        plant_options = table.model_extra or {}
        plant = self._check(table.plant, job, plant_options)
        if plant.ports is None:
            return Checked(KIND, plant.errors)
        names = {"pattern_input": table.pattern_input, "height_output": table.height_output}
        has_handshake = has_port(plant.ports.inputs, LAYER_COMMAND)
        shape = (job.nx, job.ny)
        try:
            followed = plant.ports if has_handshake else wrapped_ports(job, plant.ports, **names)
            inputs, outputs = shadow_ports(checked_inputs(followed, shape), shape)
        except ValueError as error:
            return Checked(KIND, [str(error)])
        starts_on_scan = table.start == "scan"
        ports = Ports(
            inputs, outputs, is_shadow=True, optional_inputs=Shadow.optional_inputs, starts_on_scan=starts_on_scan
        )

        def construct(bench: Bench, name: str) -> Component:
            def make_plant(wanted: Job) -> Component:  # another job: the same on another start surface
                checked = plant if wanted is job else self._check(table.plant, wanted, plant_options)
                made = checked.make(bench, name)
                return made if has_handshake else PlainPlant(wanted, made, **names)

            stop = None if table.stop_um is None else table.stop_um * M_PER_UM
            return Shadow(job, make_plant, start=table.start, alarm=table.alarm_um * M_PER_UM, stop=stop)

        return Checked(KIND, (), ports, construct, plant.single)
