"""`distloc study`: the studies' tables, plots and progress; the command line calls it."""
