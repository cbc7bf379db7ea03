"""What a run stores, and what is computed from it."""
