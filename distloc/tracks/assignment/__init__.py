"""Which track each segment goes to, all of a frame together; the tracker asks."""
