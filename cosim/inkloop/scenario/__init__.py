"""Read, check and write scenario files."""
