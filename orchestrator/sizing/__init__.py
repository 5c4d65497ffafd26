"""Sizing: the laws that suit a craft, their momentum by a model, and flights of what is
found."""
