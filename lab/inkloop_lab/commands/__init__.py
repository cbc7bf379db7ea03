"""One module for each command of the lab, see `inkloop.commands`."""
