"""Define the commands of `desat`, a file for each.

A file here, or in a folder `commands/` of another package, is a command; files of the
same name add to one command. Heavy imports stand inside functions, because
`desat --help` imports all files.
"""
