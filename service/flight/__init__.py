"""`distloc run`: opens, runs, watches and closes all that flies; the commands call it."""
