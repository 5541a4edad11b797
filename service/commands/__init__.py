"""The command line: a folder a command; `python -m service` calls it."""
