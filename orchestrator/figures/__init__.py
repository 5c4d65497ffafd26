"""How figures look, and the plots of a scenario."""
