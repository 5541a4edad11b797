"""Flights to files and back, and their replay with a score; the flight and the commands call it."""
