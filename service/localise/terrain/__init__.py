"""Elevation models from files; the ground's prior and the doctor call it."""
