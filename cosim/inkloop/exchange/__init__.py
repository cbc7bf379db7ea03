"""Scenarios in the formats of other tools."""
