"""Devices of other makers, bound to the layer contract by a mapping file."""
