"""One module for each command: `add_parser` and `run`. An implementation is imported when its command runs.

A command with parts, a folder, has `PARTS`, the modules of the parts, in place of `run`. A package adds a command by an
entry point of the group "inkloop.commands": the name of the command, and such a module.
"""
