"""Prepare a target as a case, run, supervise and resume it, and write its manifest."""
