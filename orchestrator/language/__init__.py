"""The tables of a scenario, each key declared once: what may be said."""
