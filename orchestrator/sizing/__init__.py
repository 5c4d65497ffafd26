"""Size craft: laws that suit them, a momentum-only model, and closed-loop flights."""
