"""Define the tables of a scenario, with each key declared once."""
