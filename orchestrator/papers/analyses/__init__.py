"""Analyses of what only the papers claim (`desat.analyses` says what an analysis is)."""
