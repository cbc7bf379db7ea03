"""The compiled search core: library, structures, calls."""
