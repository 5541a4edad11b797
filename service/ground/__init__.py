"""The ground station's side of zenoh; `distloc ground` calls it."""
