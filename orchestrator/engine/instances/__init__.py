"""Provide instances: bare blocks, FMUs, and FMUs in processes of their own."""
