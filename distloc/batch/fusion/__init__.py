"""Reports of many drones and bearings of towers to one picture: which are one fire, where, and who is wrong."""
