"""The processes of JuncNet, one folder each, in data order; see `juncnet.topics` for what flows."""

import os

# Eight processes with default thread pools fight each other on two cores, so every process of this
# package computes on one thread; set before any of them imports numpy, OpenCV or onnxruntime.
# Sessions of onnxruntime are given their one thread where they are made: with one there is no pool
# that could spin.
for _pool in (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
):
    os.environ.setdefault(_pool, "1")
