"""Flights, targets, errors and pictures with known truth; studies and the simulator call it."""
