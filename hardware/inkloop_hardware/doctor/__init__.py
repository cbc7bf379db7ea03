"""Examination of a bench: each finding with advice."""
