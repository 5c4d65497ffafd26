"""The commands that only the papers need."""
