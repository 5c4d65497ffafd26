"""Files: scenarios, SSP, FMUs and archives on disk."""
