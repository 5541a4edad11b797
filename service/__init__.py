"""The service around `distloc`, and its command line."""

import os

# ONNX Runtime's official builds since 1.29 keep a store of events in ~/.cache and send it to their makers, with the
# model's name, unless this says no before it is loaded. Who wants that may set it to 0.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

# NumPy's matrices here are small: shared between the threads of a busy board each takes ten times as long, as every
# thread waits for the slowest. OpenBLAS reads this once, when NumPy is first imported. Who knows better may set it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
