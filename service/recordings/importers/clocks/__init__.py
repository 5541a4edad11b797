"""The frames' clock against the poses': tied, and checked, by how the camera turns in both."""
