"""One module for each command: `add_parser` and `run`. An implementation is imported when its command runs.

A command with parts has `PARTS`, with the same two names each, in place of `run`. A package adds a command by an
entry point of the group "inkloop.commands": the name of the command, and such a module.
"""
