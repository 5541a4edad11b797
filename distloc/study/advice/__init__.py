"""Is the advice where to fly worth flying, and true? `distloc study advice` calls it."""
