"""`distloc demo`: the whole service past a simulated fire, and its map; and the simulated drone by itself."""
