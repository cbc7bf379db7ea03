"""One module for each command: `add_parser` and `run`. An implementation is imported when its command runs."""
