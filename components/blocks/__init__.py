"""Hold the blocks: this folder is the registry, one file is one block is one FMU."""
