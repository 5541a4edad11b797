"""The crew's picture over HTTP: who may see it, the page and its live channel."""
