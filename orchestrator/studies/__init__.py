"""Run studies that make runs of their own."""
