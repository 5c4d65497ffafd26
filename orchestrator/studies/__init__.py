"""Studies that make runs of their own: convergence, the estimate, the reference."""
