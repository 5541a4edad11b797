"""Whose sightings belong together: who carried each camera, what agrees on one place, and on which of several."""
