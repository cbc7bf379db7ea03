"""The score board: controllers on versioned plants, the same droplets and sensors for all."""
