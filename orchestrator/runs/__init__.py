"""Prepare a target as a case, run it, supervise and resume it, and write its
manifest.
"""
