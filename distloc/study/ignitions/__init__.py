"""Fires that really burned: sightings with known places of ignition, scored by nominal and by estimated biases."""
