"""Frames of a rig, read by its DBC: the newest of each message, and why others were dropped."""

from __future__ import annotations

from collections import Counter

from inkloop_hardware.errors import FrameError
from inkloop_hardware.protocol.codec import Codec, Frame, Reading, id_of


class Readings:
    """newest: of each message; counts: of its frames, dropped ones included."""

    def __init__(self, codec: Codec) -> None:
        self.newest: dict[str, Reading] = {}
        self.counts = Counter[str]()
        self._codec = codec
        self._names = {id_of(message): message.name for message in codec.database.messages}
        self._dropped: dict[str, str] = {}

    def take(self, frame: Frame) -> Reading | None:
        """The content of a frame; None for one that is dropped, or not in the DBC."""
        name = self._names.get(frame.arbitration_id)
        if name is None:
            return None
        self.counts[name] += 1
        try:
            reading = self._codec.decode(frame, strict=False)
        except FrameError as error:  # too short, or a container
            self._dropped[name] = str(error)
            return None
        if not reading.intact:
            self._dropped[name] = f"the check byte of {frame} is wrong; has it another data id?"
            return None
        self.newest[name] = reading
        return reading

    def found(self, message: str, signal: str) -> str:
        """The last value of a signal in words, or why there is none."""
        last = self.newest.get(message)
        if last is None:
            reason = self._dropped.get(message)
            return f"its frames were dropped: {reason}" if reason else "no frame of it was received"
        if signal in last.dropped:
            return f"its value was dropped: {last.dropped[signal]}"
        value = last.values.get(signal, float("nan"))
        return f"it is {self._codec.choice(message, signal, value) or f'{value:g}'}"
