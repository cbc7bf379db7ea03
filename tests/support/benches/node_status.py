"""Status and state of a node for tests, with fields to change."""

from __future__ import annotations

from typing import Any

from inkloop_hardware.protocol.node_state import Flags, LayerFlags, NodeState, Roles, Step
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, State

IDLE_HEAD = NodeStatus(
    node=Node.HEAD,
    lamp_on=False,
    gate_open=False,
    gate_closed=True,
    ready=True,
    state=State.IDLE,
    pass_mask=0,
    fault=Fault.NONE,
    layer=3,
    boot_count=1,
    unknown_mask=0,
    protocol_version=1,
)


def node_state(**changes: Any) -> NodeState:
    """An idle node with all roles and without a pattern, as identifier 0100 reports it, with these changes."""
    plain = dict.fromkeys(("job", "layer", "passes", "done", "unknown", "cured", "pattern_crc", "gate_pulses"), 0)
    kinds = {"flags": Flags(0), "layer_flags": LayerFlags(0), "step": Step.NONE, "roles": Roles(15)}
    known = {"state": State.IDLE, "cause": Fault.NONE, "boots": 1, "session": 1, "clock": 1.0}
    return NodeState(**{**plain, **kinds, **known, **changes})
