"""Cases and what is made of them: numbers, draws, tables, plots, reports."""
