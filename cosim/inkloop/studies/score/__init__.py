"""The score board: controllers on versioned plants, the same droplets and sensors for all."""

VERSION = "plant-v1"
PLANTS = ("lu", "lu-laser", "lu-wide", "caps", "volume-area", "young-laplace-linear", "young-laplace")
