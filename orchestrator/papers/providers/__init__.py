"""Provide the layers of values of the papers (`runs/provider.py`)."""
