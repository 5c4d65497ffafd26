"""The old name of what `desat` itself has; it goes with the next release."""
