"""A frame to a mask of smoke; the localise stage calls it."""
