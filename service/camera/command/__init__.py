"""Frames that a process of the user's choice writes to its standard output; `open_source` makes the source."""
