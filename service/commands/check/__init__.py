"""`distloc check`, the doctor: what is wrong and how to mend it; the command line calls it."""
