"""Define the commands that only the papers need."""
