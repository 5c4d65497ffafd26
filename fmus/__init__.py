"""The blocks as FMUs: the one FMI adapter, and the builder."""
