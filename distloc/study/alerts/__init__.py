"""How soon after ignition a fixed camera's smoke is told of, and how often it is told of falsely."""
