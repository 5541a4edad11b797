"""What a target's segments look like: their sizes, and how they stray."""
