"""The processes of JuncNet, one folder each, in data order; see `juncnet.topics` for what flows."""

import os

# Eight processes with default thread pools fight each other on two cores, so every process of this
# package computes on one thread; set before any of them imports numpy, OpenCV or onnxruntime.
for _pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_pool, "1")
