"""The scenarios that come with inkloop, and the files of their parts."""
