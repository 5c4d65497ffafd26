"""What the blocks of desat compute. Knows nothing of FMI, of files or of time loops."""
