"""How often the 95 % ellipse holds the truth; `distloc study coverage` calls it."""
