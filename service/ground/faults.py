"""What keeps the ground from starting: one line that names the option."""


class GroundError(Exception):
    """A port, a folder or a file that cannot be used."""
