"""Options of commands: in groups, with units, and the one that names a program."""
