"""Translate a block's Python to C99; `program.translate` returns the source."""
