"""The course of a print, which a master follows: its layers, its end, and events on the way."""
