"""Runs systems of FMUs: scenarios, SSP, check, master, results, command line."""
