"""Write FMUs: from variables.toml to C tables, model description and archive."""

FORMS = ("fmi3", "fmi3-fixed", "fmi2")
"""FMI 3 with structural parameters, FMI 3 with constant dimensions, FMI 2 with a scalar per cell."""
