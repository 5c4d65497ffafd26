"""Define the command that writes the page."""
