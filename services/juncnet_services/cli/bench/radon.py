"""`juncnet bench radon`: reconstruction of 64x64 pictures beside scikit-image, in the same run.

The threads of the matrix library are the services' (one), unless the environment says otherwise.
"""

import argparse
import importlib
import importlib.util
import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet.radon import evenly_spaced_angles
from juncnet.radon_cache import load_reconstruction
from juncnet.radon_geometry import Geometry
from juncnet.radon_operator import Reconstruction
from juncnet_services.cli.bench.figures import Figure, median, p99, show
from juncnet_services.cli.ranges import whole

F32 = NDArray[np.float32]
SIZE, ANGLES, BATCH = 64, 180, 30
TOLERANCE = 1e-4
ORACLE = "scikit-image"
CACHE_FLUSH_BYTES = 96 * 2**20
"""More than any cache of the machines this is meant for."""


@dataclass(frozen=True)
class Options:
    """How often each thing is measured."""

    repeats: int
    oracle_repeats: int


def main(argv: list[str]) -> int:
    """Measure and print; 0, whether targets are reached or not."""
    parser = argparse.ArgumentParser(prog="juncnet bench radon", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print a list of figures as JSON")
    parser.add_argument("--repeats", type=whole(1), default=200, help="measurements of each figure")
    arguments = parser.parse_args(argv)
    options = Options(arguments.repeats, max(10, arguments.repeats // 5))
    figures = [*measure(False, options), *measure(True, options), *measure_astra(options)]
    show(figures, arguments.json)
    return 0


def measure(circle: bool, options: Options) -> list[Figure]:
    """Return the figures for one setting of `circle`."""
    geometry = Geometry(SIZE, evenly_spaced_angles(ANGLES), "ramp", circle)
    reconstruct = load_reconstruction(geometry)
    pictures = np.random.default_rng(0).random((BATCH, SIZE, SIZE), dtype=np.float32)
    single = pictures[:1]
    prefix = f"circle={circle}"
    dense = dense_matrix(reconstruct)
    flat = single.ravel()
    times = {
        "ours, one frame, warm": timed(lambda: reconstruct(single), options.repeats),
        "ours, one frame, cold cache": timed(
            lambda: reconstruct(single), options.repeats // 2, flush_cache
        ),
        "ours, batch of 30, a frame": timed(
            lambda: reconstruct(pictures), options.repeats // 2, divisor=BATCH
        ),
        "dense matrix, one frame, warm": timed(lambda: dense @ flat, options.repeats // 2),
    }
    oracle = scikit_image(geometry)
    if oracle is not None:
        times[ORACLE] = timed(lambda: oracle(single[0]), options.oracle_repeats)
    sizes = {"ours": reconstruct.matrix.nbytes, "dense": dense.nbytes}
    figures: list[Figure] = []
    for name, seconds in times.items():
        size = next((n for kind, n in sizes.items() if name.startswith(kind)), None)
        memory = "" if size is None else f", matrix {size / 1e6:.1f} MB"
        figures.append(
            in_ms(f"{prefix}: {name}", seconds, f"BLAS threads: {blas_threads()}{memory}")
        )
    if oracle is None:
        return figures
    for name, target in (
        ("ours, one frame, warm", 20.0),
        ("ours, one frame, cold cache", 20.0),
        ("ours, batch of 30, a frame", 50.0),
    ):
        ratio = median(times[ORACLE]) / median(times[name])
        text = f"{prefix}: {name}, against {ORACLE}"
        figures.append(Figure.against(text, ratio, "x", target, note="ratio of medians"))
    worst = max(float(np.abs(reconstruct(p[None])[0] - oracle(p)).max()) for p in probes())
    text = f"{prefix}: largest deviation from {ORACLE}"
    figures.append(
        Figure.against(text, worst, "", TOLERANCE, at_most=True, note="random, structured")
    )
    return figures


def in_ms(name: str, seconds: Sequence[float], note: str) -> Figure:
    """Return a figure of measured times, in milliseconds."""
    return Figure(
        name=name,
        value=1e3 * median(seconds),
        p99=1e3 * p99(seconds),
        n=len(seconds),
        unit="ms",
        note=note,
    )


def timed(
    call: Callable[[], object],
    repeats: int,
    before: Callable[[], object] | None = None,
    divisor: int = 1,
) -> list[float]:
    """Return the seconds of each call, over `divisor`; what runs `before` it is not timed."""
    call()
    seconds: list[float] = []
    for _ in range(max(1, repeats)):
        if before is not None:
            before()
        start = time.perf_counter()
        call()
        seconds.append((time.perf_counter() - start) / divisor)
    return seconds


_flushed = np.zeros(CACHE_FLUSH_BYTES // 8)


def flush_cache() -> None:
    """Drive everything else out of the processor's caches."""
    np.add(_flushed, 1.0, out=_flushed)


def blas_threads() -> str:
    """Return how many threads the matrix library was told to use (OPENBLAS_NUM_THREADS)."""
    return os.environ.get("OPENBLAS_NUM_THREADS", "all")


def dense_matrix(reconstruct: Reconstruction) -> F32:
    """Return the map as one matrix (S * S, S * S): what every unit impulse is reconstructed to."""
    size = reconstruct.geometry.size
    matrix = np.empty((size * size, size * size), np.float32)
    for row in range(size):
        impulses = np.zeros((size, size, size), np.float32)
        impulses[np.arange(size), row, np.arange(size)] = 1.0
        matrix[:, row * size : (row + 1) * size] = reconstruct(impulses).reshape(size, -1).T
    return matrix


def probes() -> list[F32]:
    """Return pictures in [0, 1] on which the deviation is taken: noise, and what has structure."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:SIZE, :SIZE] / (SIZE - 1.0)
    shapes = [
        np.ones((SIZE, SIZE)),
        x,
        (x + y > 1.0) * 1.0,
        (np.hypot(x - 0.5, y - 0.5) < 0.3) * 1.0,
        (np.indices((SIZE, SIZE)).sum(0) % 2) * 1.0,
        0.5 + 0.5 * np.sin(40.0 * x) * np.cos(25.0 * y),
    ]
    noise = [rng.random((SIZE, SIZE)) for _ in range(10)]
    coins = [(rng.random((SIZE, SIZE)) < 0.5) * 1.0 for _ in range(4)]
    return [picture.astype(np.float32) for picture in [*shapes, *noise, *coins]]


def scikit_image(geometry: Geometry) -> Callable[[F32], F32] | None:
    """Return scikit-image's reconstruction, or None where it is not installed."""
    if importlib.util.find_spec("skimage") is None:
        return None
    transform: Any = importlib.import_module("skimage.transform")
    angles, circle = np.asarray(geometry.angles_deg), geometry.circle

    def reconstruct(picture: F32) -> F32:
        with warnings.catch_warnings():
            # It warns of pixels outside the circle, which it then counts as we do.
            warnings.simplefilter("ignore", UserWarning)
            sinogram = transform.radon(picture, angles, circle=circle)
        return transform.iradon(sinogram, angles, filter_name=geometry.filter_name, circle=circle)

    return reconstruct


def measure_astra(options: Options) -> list[Figure]:
    """Return ASTRA's time for the same work (its own discretisation), or nothing without it."""
    if importlib.util.find_spec("astra") is None:
        return []
    astra: Any = importlib.import_module("astra")
    picture = np.random.default_rng(0).random((SIZE, SIZE), dtype=np.float32)
    volume = astra.create_vol_geom(SIZE, SIZE)
    angles = np.deg2rad(evenly_spaced_angles(ANGLES))
    projector = astra.create_projector(
        "linear", astra.create_proj_geom("parallel", 1.0, 91, angles), volume
    )
    operator = astra.OpTomo(projector)
    name = f"ASTRA {astra.__version__}, one frame"
    times = timed(lambda: operator.reconstruct("FBP", operator * picture), options.oracle_repeats)
    return [in_ms(name, times, "CPU, its own discretisation")]
