"""`distloc bench`: what each part of distloc costs on this machine, in one run; the files are what is measured."""
