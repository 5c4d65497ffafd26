"""The families' pages under docs/papers: `python -m benchmarks.pages`."""
