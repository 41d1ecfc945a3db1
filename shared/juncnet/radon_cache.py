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

import numpy as np

from juncnet import radon, radon_operator
from juncnet.radon_operator import Blocks, Geometry, Reconstruction, block_sizes, build_blocks


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
    blocks = _read(path, geometry)
    if blocks is None:
        blocks = build_blocks(geometry)
        with contextlib.suppress(OSError):
            _write(path, blocks)
    return Reconstruction(geometry, blocks)


def _key(geometry: Geometry) -> str:
    digest = hashlib.sha256(repr(geometry).encode())
    for module in (radon, radon_operator):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()[:32]


def _read(path: Path, geometry: Geometry) -> Blocks | None:
    """Return the blocks in the file; None when it is missing, damaged or not what it should be."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            blocks: Blocks = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None
    sizes = {name: block.shape for name, block in blocks.items()}
    wanted = {name: (n, n) for name, n in block_sizes(geometry).items()}
    right = sizes == wanted and all(block.dtype == np.float32 for block in blocks.values())
    return blocks if right else None


def _write(path: Path, blocks: Blocks) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **blocks)  # pyright: ignore[reportArgumentType] (names are not options)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
