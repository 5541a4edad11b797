"""What the pilot is told in texts: faults, the compass, new fires, where to fly."""
