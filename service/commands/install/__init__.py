"""`distloc install`: the systemd service on a machine or in an image; the command line calls it."""
