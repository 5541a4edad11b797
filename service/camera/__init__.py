"""Where frames come from, and whether they can be used; the flight and the frames' pipeline call it."""
