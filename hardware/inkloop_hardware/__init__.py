"""inkloop on a CAN bus: frames, transport, device components and the emulated bench."""
