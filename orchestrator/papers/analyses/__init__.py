"""Analyse claims that only the papers make (`desat.analyses` defines analyses)."""
