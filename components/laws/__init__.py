"""Provide momentum-management laws as functions, one module for each family.

The modules cite the equations.
"""
