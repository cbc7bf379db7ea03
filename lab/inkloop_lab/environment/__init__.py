"""A scenario as an environment of Gymnasium."""
