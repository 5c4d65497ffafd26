"""Build the blocks as FMUs: the FMI adapter and the builder."""
