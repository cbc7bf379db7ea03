"""Frames as python-can has them, and back."""

from __future__ import annotations

import can

from inkloop_hardware.protocol.codec import EXTENDED, Frame


def message_of(frame: Frame, *, bit_rate_switch: bool = False) -> can.Message:
    """A frame that is to be sent; bit_rate_switch: the data of one of CAN FD travel at the data bit rate."""
    return can.Message(
        arbitration_id=frame.arbitration_id & ~EXTENDED,
        is_extended_id=bool(frame.arbitration_id & EXTENDED),
        is_fd=frame.is_fd,
        bitrate_switch=frame.is_fd and bit_rate_switch,
        data=frame.data,
        is_rx=False,
    )


def data_frame(message: can.Message) -> Frame | None:
    """The frame of a message, None for an error or remote frame."""
    if message.is_error_frame or message.is_remote_frame:
        return None
    identifier = message.arbitration_id | EXTENDED * message.is_extended_id
    return Frame(identifier, bytes(message.data), message.is_fd)
