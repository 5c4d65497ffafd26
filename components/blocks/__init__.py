"""The blocks. This folder is the registry: one file is one block is one FMU."""
