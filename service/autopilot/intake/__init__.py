"""Which of the frames on the links count, and whose; the autopilot calls it."""
