"""Reproduction of the papers behind the models: published figures next to computed ones."""

PAPERS = {"lu": "lu", "wu-chiu": "wu_chiu", "hume-rosen": "hume_rosen"}
"""Name of a paper on the command line -> module with its `PAPER`."""
