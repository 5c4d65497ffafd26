"""A file a command: what is added here, or in a folder `commands/` of another room, is
a command of `desat`; files of the same name add to one command. Files import what is
heavy inside their functions, for `desat --help` imports them all."""
