"""The co-simulation master: which component steps when, and what travels between them."""
