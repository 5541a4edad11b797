"""The ground station's side."""
