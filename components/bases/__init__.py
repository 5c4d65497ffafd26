"""Provide the bases that several blocks of a role share."""
