"""The config file: its keys, what is wrong with them, and the secrets that they name; every room calls it."""
