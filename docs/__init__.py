"""The generator of the pages under docs/papers: `make papers`."""
