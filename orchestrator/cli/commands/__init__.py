"""A file a command: what is added here is a command of `desat`. Files import what is heavy inside
their functions, for `desat --help` imports them all."""
