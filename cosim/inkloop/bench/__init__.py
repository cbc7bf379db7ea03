"""The CAN bench from the command line: emulate one, command its devices, examine it, replay a run."""
