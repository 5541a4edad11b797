"""The particle filters over one target, what is known beforehand of it, and ellipses; the tracks call it."""
