"""`distloc soak`: the whole service for long, with faults, and what is judged of it; the command line calls it."""
