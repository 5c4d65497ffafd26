"""Momentum-management laws as functions, one module a family, equations cited."""
