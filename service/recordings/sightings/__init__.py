"""A table of sightings as a file: its columns, what its rows say, and what of the whole looks wrong."""
