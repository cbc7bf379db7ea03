"""The prediction model of a layer, and the permitted droplets of each cell."""
