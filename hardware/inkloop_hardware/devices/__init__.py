"""Printer and profiler as components, and the steps of a layer on devices."""
