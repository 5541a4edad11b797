"""A made-up landscape that is no plane, as a camera with the faults of a real one sees it."""
