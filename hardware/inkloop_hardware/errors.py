"""Errors of the bench, split by who can mend them."""

from __future__ import annotations

from inkloop.errors import InkloopError


class FrameError(InkloopError):
    """A frame or a value does not fit the DBC; the message names both and says what would."""
