"""A status of a node for tests, with fields to change."""

from __future__ import annotations

from inkloop_hardware.protocol.records import NodeStatus
from inkloop_hardware.protocol.vocabulary import Fault, Node, State

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
