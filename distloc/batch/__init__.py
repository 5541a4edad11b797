"""Many sightings at once, from any platforms and in any order: places with ellipses, for who has a table of them."""
