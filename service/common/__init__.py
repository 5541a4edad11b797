"""What all rooms hand each other, and small tools without a stage of their own; every room calls it."""
