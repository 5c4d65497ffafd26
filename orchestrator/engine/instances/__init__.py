"""Instances of components: bare blocks, FMUs, and those in processes of their own."""
