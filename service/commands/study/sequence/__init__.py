"""`study sequence`: each method on one recorded flight with truth."""
