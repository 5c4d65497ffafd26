"""What validates the exchange: a monolithic reference, and runs held against it.

    python -m benchmarks.validation convergence gyrostat/free --steps 1,0.5

The reference knows nine blocks by name and steps all of a craft as one system of
equations. Pages that are made of it, those of `gyrostat`, take verbs beyond those of
all pages: `verbs.py`.
"""
