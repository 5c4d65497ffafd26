"""A system of components as data: interfaces, connections, checks, schedule. No files."""
