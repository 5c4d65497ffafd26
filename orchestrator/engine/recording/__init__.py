"""Write the rows of a run to its series, and read the series again."""
