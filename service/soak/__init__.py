"""`distloc soak`: the whole service for as long as asked, at real rates and with faults, measured from outside."""
