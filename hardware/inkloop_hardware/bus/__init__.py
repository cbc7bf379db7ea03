"""The adapter, the process that owns it, and the frames that cross it."""
