"""Measured surfaces: height maps from files of profilers, and their placement on the grid of cells."""
