"""Whether a target stands, creeps as a fire's front does, or is driven: what its bearings and its looks tell."""
