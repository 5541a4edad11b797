"""The paper's experiments and ours over simulated flights; `distloc study` calls it."""
