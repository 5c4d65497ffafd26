"""Export a loop as one FMU, a block as C, series as tables, a system as .ssp."""
