"""`distloc locate`: a table of sightings to places on the map."""
