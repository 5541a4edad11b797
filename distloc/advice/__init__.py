"""Where to fly next: of the ways that a craft can fly, the one after which a fire's ellipse is the smallest."""
