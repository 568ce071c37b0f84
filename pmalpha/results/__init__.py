"""What a run records, and what becomes of it."""
