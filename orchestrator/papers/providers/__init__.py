"""The layers of values that the papers provide (`runs/provider.py`)."""
