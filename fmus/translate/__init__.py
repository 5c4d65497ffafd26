"""From a block's Python to C99: `program.translate` gives the C source of a block."""
