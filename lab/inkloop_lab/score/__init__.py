"""The score board: controllers on versioned plants, the same droplets and sensors for all."""

VERSIONS = {
    "plant-v1": ("lu", "lu-laser", "lu-wide", "caps", "volume-area", "young-laplace-linear", "young-laplace"),
    "plant-v2": ("lu-shift", "lu-spot", "lu-dropout", "lu-scans", "caps-scans", "young-laplace-shift"),
}
"""The plants of each version: printers in the first, errors of scans in the second. A version never changes."""
PLANTS = tuple(f"{version}/{plant}" for version, plants in VERSIONS.items() for plant in plants)
