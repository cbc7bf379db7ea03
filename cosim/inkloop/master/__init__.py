"""The co-simulation master: who steps when, and what travels between components."""
