"""Flights with drawn frames and the real tracker, with and without the scenery; `distloc study drawn` calls it."""
