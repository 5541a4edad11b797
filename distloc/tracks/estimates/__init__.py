"""Where targets are by their clouds, and what is reported of them."""
