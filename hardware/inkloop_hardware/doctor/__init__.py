"""Examine a bench and report each finding with advice."""
