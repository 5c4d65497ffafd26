"""Compare with papers: their tables beside our numbers, stored samples, pages."""
