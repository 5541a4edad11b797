"""From a mask to measured directions with their errors; the localizer and the tracks call it."""
