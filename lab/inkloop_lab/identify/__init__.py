"""Identification of an ink: from patterns and measured surfaces to the coefficients of the deposition models."""
