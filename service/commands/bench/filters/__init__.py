"""Filter steps beside the paper's and with many targets; the bench calls it."""
