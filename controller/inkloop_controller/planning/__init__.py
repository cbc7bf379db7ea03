"""Plan the next layer over the horizon."""
