"""An independent rig in NumPy alone: plant, profiler and loop, for scans and droplets that are not as expected."""
