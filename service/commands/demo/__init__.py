"""`distloc demo`: the whole service past a simulated fire, and its map; the command line calls it."""
