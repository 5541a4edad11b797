"""`distloc study fires`: sightings of fires that really burned, against where they began."""
