"""What the crew sees: drones, fires and marks, bounded and free of I/O. `service.ground.crew` feeds and serves it."""
