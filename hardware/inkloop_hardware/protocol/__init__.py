"""Frames, records and services of the bench, from the DBC."""
