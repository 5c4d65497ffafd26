"""Represent a system as data: interfaces, connections, checks, schedule. No files."""
