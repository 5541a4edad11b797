"""Targets to zenoh, MAVLink and pictures, and what the pilot is told; the flight and the recordings call it."""
