"""`distloc calibrate`: the mount's angles from a recorded flight past a landmark; the command line calls it."""
