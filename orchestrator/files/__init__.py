"""Read and write files: scenarios, SSP, FMUs and archives on disk."""
