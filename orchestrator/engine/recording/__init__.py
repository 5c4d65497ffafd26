"""Rows of a run on their way to its series, and the series read again."""
