"""A simulated autopilot, camera, operator and their scenario; demo, soak, bench and tests call it."""
