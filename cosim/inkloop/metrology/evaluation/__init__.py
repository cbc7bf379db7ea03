"""Evaluation of a measured surface: filters, areal and profile parameters, form, outline and volume.

All of it works on masked, incomplete maps: no height is invented where none was measured. The equations and the choices
are on docs/reference/metrology.md.
"""
