"""What a frame goes through until its targets are on the map, live and in a replay; flight and recordings call it."""
