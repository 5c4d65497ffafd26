"""Compute numbers and texts from series: measures, derived quantities, statistics."""
