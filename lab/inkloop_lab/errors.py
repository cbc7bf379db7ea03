"""Errors of studies."""

from __future__ import annotations

from inkloop.errors import InkloopError


class IdentificationError(InkloopError):
    """Logged patterns and surfaces cannot be read, or do not determine the requested ink."""
