"""Provide mathematics without any knowledge of spacecraft."""
