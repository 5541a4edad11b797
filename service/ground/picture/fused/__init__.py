"""Fires of several drones and towers as one: what is compared, fused, named, and told of it."""
