"""Measured surfaces: height maps from the files of profilers, and where they lie on the grid of cells."""
