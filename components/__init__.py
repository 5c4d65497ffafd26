"""Provide the computations of the blocks of desat.

This package knows nothing of FMI, of files or of time loops.
"""
