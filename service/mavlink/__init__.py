"""Bytes to MAVLink frames and back, on every link; the flight and the doctor call it."""
