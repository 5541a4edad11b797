"""Cameras, rotations, places on the earth and rays that meet; everything else in distloc calls it."""
