"""Recorded traffic as a bench."""
