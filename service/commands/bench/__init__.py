"""`distloc bench`: what each part costs on this machine; the command line calls it."""
