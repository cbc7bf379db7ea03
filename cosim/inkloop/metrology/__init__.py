"""Measured surfaces: height maps from and to files, their placement on the grid of cells, and their texture."""

UNITS = ("nm", "um", "mm", "m")
"""Units of heights that a caller can give."""
