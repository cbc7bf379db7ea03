"""Measured surfaces: height maps from and to files, their placement on the grid of cells, and their texture."""

F_OPERATIONS = ("plane", "mean")
"""What is taken off a surface before its texture is evaluated: the least-squares plane, or the mean height."""
UNITS = ("nm", "um", "mm", "m")
"""Units of heights that a caller can give."""
