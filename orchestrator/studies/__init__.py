"""Studies that make runs of their own."""
