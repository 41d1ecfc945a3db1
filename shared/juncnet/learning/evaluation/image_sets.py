"""MNIST and CIFAR-10 from the files that people have, scaled once to the network's size."""

import gzip
import hashlib
import tarfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = 64
"""Side of the paper's network input."""
Pictures = NDArray[np.uint8]
Labels = NDArray[np.int64]
DIGITS = tuple("0123456789")
CIFAR_CLASSES = (
    *("airplane", "automobile", "bird", "cat", "deer"),
    *("dog", "frog", "horse", "ship", "truck"),
)
IDX_PICTURES, IDX_LABELS = 0x803, 0x801


class ImageSetError(ValueError):
    """Files are not the image set that they should be; the text says which and what to do."""


@dataclass(frozen=True)
class ImageSet:
    """A set of small pictures with its own division into training and test."""

    name: str
    """As tables call it, with what distinguishes the copy (`JPEG CIFAR-10`)."""
    classes: tuple[str, ...]
    mirror: bool
    """Whether a mirrored picture keeps its class."""
    train: Pictures
    """(N, S, S) or, in colour, (N, S, S, 3), red first."""
    train_label: Labels
    test: Pictures
    test_label: Labels

    def limited(self, count: int | None) -> "ImageSet":
        """Return the set with `count` training and test pictures at most, drawn at random."""
        if count is None:
            return self
        rng = np.random.default_rng(0)
        train = rng.permutation(len(self.train))[:count]
        test = rng.permutation(len(self.test))[:count]
        return ImageSet(
            self.name,
            self.classes,
            self.mirror,
            self.train[train],
            self.train_label[train],
            self.test[test],
            self.test_label[test],
        )


def load_mnist(folder: Path) -> ImageSet:
    """Return MNIST from a folder with its four IDX files, gzipped or not.

    Raises:
        ImageSetError: a file is missing or is no IDX file of this kind.
    """
    arrays = [
        _idx(folder, name, magic)
        for part in ("train", "t10k")
        for name, magic in (
            (f"{part}-images-idx3-ubyte", IDX_PICTURES),
            (f"{part}-labels-idx1-ubyte", IDX_LABELS),
        )
    ]
    train, train_label, test, test_label = arrays
    for pictures, labels in ((train, train_label), (test, test_label)):
        if len(pictures) != len(labels):
            raise ImageSetError(f"{folder}: {len(pictures)} pictures, {len(labels)} labels")
    return ImageSet(
        "MNIST",
        DIGITS,
        False,
        enlarged(train),
        train_label.astype(np.int64),
        enlarged(test),
        test_label.astype(np.int64),
    )


def _idx(folder: Path, name: str, magic: int) -> NDArray[np.uint8]:
    plain, packed = folder / name, folder / f"{name}.gz"
    try:
        data = plain.read_bytes() if plain.exists() else gzip.decompress(packed.read_bytes())
    except FileNotFoundError as error:
        raise ImageSetError(f"{folder} has no {name}(.gz): give MNIST's folder") from error
    except (OSError, EOFError) as error:
        raise ImageSetError(f"{packed}: not a gzip file ({error}): get it again") from error
    sizes = np.frombuffer(data[:16], ">u4")
    dimensions = magic & 0xFF
    if len(data) < 16 or sizes[0] != magic:
        raise ImageSetError(f"{folder / name}: not an IDX file of this kind: get it again")
    shape = tuple(int(size) for size in sizes[1 : 1 + dimensions])
    values = np.frombuffer(data, np.uint8, offset=4 * (1 + dimensions))
    if len(values) != np.prod(shape):
        raise ImageSetError(f"{folder / name}: cut off: get it again")
    return values.reshape(shape)


def load_cifar10(path: Path) -> ImageSet:
    """Return CIFAR-10 from the original `cifar-10-binary.tar.gz` or from JPEG copies.

    The latter are one `.npz` with `train_bytes`, `train_offsets` (N + 1,), `train_y` and the same
    for `test`; as they are lossy, the set is then called *JPEG CIFAR-10*.

    Raises:
        ImageSetError: the file is neither.
    """
    if not path.is_file():
        raise ImageSetError(f"{path}: no such file: give cifar-10-binary.tar.gz or JPEGs as .npz")
    try:
        if zipfile.is_zipfile(path):
            return _cifar("JPEG CIFAR-10", *_jpeg_parts(path))
        return _cifar("CIFAR-10", *_binary_parts(path))
    except (tarfile.TarError, KeyError, EOFError, OSError, ValueError) as error:
        raise ImageSetError(
            f"{path}: neither cifar-10-binary.tar.gz nor an .npz of JPEGs: {error}"
        ) from error


def _cifar(
    name: str, train: Pictures, train_label: Labels, test: Pictures, test_label: Labels
) -> ImageSet:
    return ImageSet(
        name, CIFAR_CLASSES, True, enlarged(train), train_label, enlarged(test), test_label
    )


def _jpeg_parts(path: Path) -> tuple[Pictures, Labels, Pictures, Labels]:
    with np.load(path, allow_pickle=False) as data:
        train, test = (
            _decoded(data[f"{part}_bytes"], data[f"{part}_offsets"]) for part in ("train", "test")
        )
        return (
            train,
            data["train_y"].astype(np.int64),
            test,
            data["test_y"].astype(np.int64),
        )


def _decoded(content: Pictures, offsets: NDArray[np.int64]) -> Pictures:
    pictures = np.empty((len(offsets) - 1, 32, 32, 3), np.uint8)
    for i, target in enumerate(pictures):
        picture = cv2.imdecode(content[offsets[i] : offsets[i + 1]], cv2.IMREAD_COLOR)
        if picture is None or picture.shape != target.shape:
            raise ValueError(f"picture {i} is no JPEG of 32x32")
        target[:] = picture[..., ::-1]
    return pictures


def _binary_parts(path: Path) -> tuple[Pictures, Labels, Pictures, Labels]:
    with tarfile.open(path) as archive:
        members = {Path(m.name).name: m for m in archive.getmembers() if m.isfile()}
        parts: dict[str, NDArray[np.uint8]] = {}
        for name in (*(f"data_batch_{i}.bin" for i in range(1, 6)), "test_batch.bin"):
            file = archive.extractfile(members[name])
            content = b"" if file is None else file.read()
            parts[name] = np.frombuffer(content, np.uint8).reshape(-1, 3073)
    test = parts.pop("test_batch.bin")
    train = np.concatenate(list(parts.values()))
    planes = [rows[:, 1:].reshape(-1, 3, 32, 32).transpose(0, 2, 3, 1) for rows in (train, test)]
    return planes[0], train[:, 0].astype(np.int64), planes[1], test[:, 0].astype(np.int64)


def enlarged(pictures: Pictures) -> Pictures:
    """Return pictures (N, h, w) or (N, h, w, 3) at the network's size, interpolated bicubically."""
    size = (SIZE, SIZE)
    result = np.empty((len(pictures), *size, *pictures.shape[3:]), np.uint8)
    for target, picture in zip(result, pictures, strict=True):
        cv2.resize(np.ascontiguousarray(picture), size, target, interpolation=cv2.INTER_CUBIC)
    return result


def digest(pictures: Pictures) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of the pixels: which copy it was."""
    return hashlib.sha256(np.ascontiguousarray(pictures).tobytes()).hexdigest()[:16]
