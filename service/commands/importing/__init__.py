"""`distloc import`: logs, films and stills of others to a recording; the command line calls it."""
