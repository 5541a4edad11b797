"""A GPU for the model, in a process of its own: the service begins on the CPU and goes over once that one is ready."""
