"""Draw figures, and the plots of a scenario."""
