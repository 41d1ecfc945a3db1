"""Reconstruction maps kept on disk: built once, then read in milliseconds.

A file's name is the hash of the map's parameters and of the code that builds it, so a changed build
never meets an old file. Files appear whole or not at all; one that cannot be read is built again.
"""

import contextlib
import hashlib
import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet import radon, radon_build, radon_coordinates, radon_geometry, radon_operator
from juncnet.radon_build import build
from juncnet.radon_coordinates import Coordinates
from juncnet.radon_geometry import Geometry
from juncnet.radon_operator import Correction, Matrix, Reconstruction


def cache_directory() -> Path:
    """Return the user's cache for maps: `$XDG_CACHE_HOME/juncnet` or `~/.cache/juncnet`."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "juncnet"


def load_reconstruction(geometry: Geometry, directory: Path | None = None) -> Reconstruction:
    """Return the map of `geometry`, read from the cache or built (seconds) and put there.

    `directory` is where the cache lies, None: `cache_directory()`. A cache that cannot be written
    only costs time.
    """
    path = (directory or cache_directory()) / f"radon-{_key(geometry)}.npz"
    matrix = _read(path, geometry)
    if matrix is None:
        matrix = build(geometry)
        with contextlib.suppress(OSError):
            _write(path, matrix)
    return Reconstruction(geometry, matrix)


def _key(geometry: Geometry) -> str:
    digest = hashlib.sha256(repr(geometry).encode())
    for module in (radon, radon_build, radon_coordinates, radon_geometry, radon_operator):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()[:32]


def _read(path: Path, geometry: Geometry) -> Matrix | None:
    """Return the matrix in the file; None when it is missing, damaged or not what it should be."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
            matrix = _matrix(arrays)
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None
    return matrix if _fits(matrix, geometry) else None


def _fits(matrix: Matrix, geometry: Geometry) -> bool:
    coordinates = Coordinates(geometry)
    shapes = {name: block.shape for name, block in matrix.blocks.items()}
    group = len(coordinates.signs)
    elements = group * len(coordinates.kept), coordinates.inputs.size
    pixels = geometry.size**2, geometry.size**2
    return (
        shapes == {name: block.shape for name, block in coordinates.blocks.items()}
        and all(block.dtype == np.float32 for block in matrix.blocks.values())
        and all(_consistent(correction, *elements) for correction in matrix.rim)
        and all(_consistent(correction, *pixels) for correction in matrix.cut)
    )


def _consistent(correction: Correction, targets: int, sources: int) -> bool:
    """Return whether a correction can be applied to so many elements."""
    sizes = [factor.shape for factor in correction.factors]
    ends = [len(correction.targets), *(n for shape in sizes for n in shape)]
    ends.append(len(correction.sources))
    return (
        all(factor.dtype == np.float32 and factor.ndim == 2 for factor in correction.factors)
        and ends[0::2] == ends[1::2]
        and 0 <= correction.targets.min() <= correction.targets.max() < targets
        and correction.sources.max(initial=0) < sources
    )


def _matrix(arrays: dict[str, NDArray[Any]]) -> Matrix:
    """Return the matrix that `_arrays` wrote. KeyError: something is missing."""
    blocks = {n.removeprefix("block."): a for n, a in arrays.items() if n.startswith("block.")}

    def corrections(kind: str) -> tuple[Correction, ...]:
        found: list[Correction] = []
        while (prefix := f"{kind}.{len(found)}.") + "targets" in arrays:
            count = sum(name.startswith(prefix + "factor.") for name in arrays)
            factors = tuple(arrays[f"{prefix}factor.{i}"] for i in range(count))
            found.append(
                Correction(arrays[prefix + "targets"], arrays[prefix + "sources"], factors)
            )
        return tuple(found)

    return Matrix(blocks, corrections("rim"), corrections("cut"))


def _arrays(matrix: Matrix) -> dict[str, NDArray[Any]]:
    """Return all arrays of a matrix by the names that they have in the file."""
    arrays: dict[str, NDArray[Any]] = {f"block.{n}": a for n, a in matrix.blocks.items()}
    for kind, corrections in (("rim", matrix.rim), ("cut", matrix.cut)):
        for i, correction in enumerate(corrections):
            arrays[f"{kind}.{i}.targets"] = correction.targets
            arrays[f"{kind}.{i}.sources"] = correction.sources
            for k, factor in enumerate(correction.factors):
                arrays[f"{kind}.{i}.factor.{k}"] = factor
    return arrays


def _write(path: Path, matrix: Matrix) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, allow_pickle=False, **_arrays(matrix))
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
