"""The tables of a scenario file as types, and values derived from them alone."""
