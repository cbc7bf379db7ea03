"""The papers that the models are from, reproduced: what they print beside what comes out here."""

PAPERS = {"lu": "lu", "wu-chiu": "wu_chiu", "hume-rosen": "hume_rosen"}
"""Name of a paper on the command line -> module with its `PAPER`."""
