"""The mount's angles and the frames' lateness from a flight past a landmark; `distloc calibrate` calls it."""
