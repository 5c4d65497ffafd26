"""The command that writes the page."""
