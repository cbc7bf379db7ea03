"""The tables of a scenario file as types, and what follows from them alone."""
