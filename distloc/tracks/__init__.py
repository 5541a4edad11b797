"""Which detection is whose, and each target's life and place; the localizer calls it."""
