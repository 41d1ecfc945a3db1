"""Labelled pictures on disk, whatever made them: one format, one reader, one writer.

A dataset is a folder with `dataset.json` (`DatasetInfo`: the classes, how it was made) and either

- `samples.csv` with the columns `path, class, clip, site, split, time_s`, one picture a line, and
  the pictures (`*.jpg`, `*.png`, ...) at those paths inside the folder; or
- shards: `*.npz` files of equal pictures (`juncnet.learning.samples.Samples`), named in
  `dataset.json`, whose pictures stay on disk until they are asked for.

A folder without `dataset.json` is read as class folders: each folder in it is a class, each folder
in that a site, `CLASS/picture.jpg` or `CLASS/SITE/picture.jpg`.
"""

import csv
import io
import math
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from juncnet.messages import Name

INFO, TABLE = "dataset.json", "samples.csv"
COLUMNS = ("path", "class", "clip", "site", "split", "time_s")
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp")
Split = Literal["", "train", "validation", "test"]
SPLITS: tuple[Split, ...] = ("", "train", "validation", "test")
"""Which part of a dataset a picture belongs to; empty: nobody has decided."""
Bytes = NDArray[np.uint8]


class DatasetError(ValueError):
    """A folder is no dataset that can be read; the text says what is wrong and what to do."""


class DatasetInfo(BaseModel):
    """The content of `dataset.json`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    classes: tuple[Name, ...] = Field(min_length=2)
    """In the order of the indices in `Dataset.label`."""
    made_by: str = ""
    """The command that made it."""
    shards: tuple[str, ...] = ()
    """Names of `.npz` files in the folder; none: the pictures are listed in `samples.csv`."""
    notes: dict[str, str] = {}
    """Anything else that a reader of the figures should know."""


@dataclass(frozen=True)
class Row:
    """One line of `samples.csv`."""

    path: str
    """Relative to the dataset's folder, with forward slashes."""
    label: str
    """The class: column `class`."""
    clip: str = ""
    site: str = ""
    split: Split = ""
    time_s: float = math.nan
    """Since the clip's begin; NaN: unknown."""


class _Store(Protocol):
    """Where the pictures are."""

    def picture(self, index: int) -> Bytes: ...
    def array(self, name: Literal["gray", "mask"], rows: NDArray[np.int64]) -> Bytes | None: ...


@dataclass(frozen=True)
class Dataset:
    """Labelled pictures; all arrays have the same length N, and pictures are read when asked for.

    Splits are by site or clip, never by picture.
    """

    classes: tuple[str, ...]
    label: NDArray[np.int64]
    """(N,): index into `classes`; -1: a picture of no class (synthetic: the transition band)."""
    target: NDArray[np.float32]
    """(N, classes): probabilities to learn; NaN: nobody could say, leave the picture out."""
    clip: NDArray[np.str_]
    site: NDArray[np.str_]
    split: NDArray[np.str_]
    time_s: NDArray[np.float64]
    info: DatasetInfo
    _store: _Store
    _row: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.label)

    def picture(self, index: int) -> Bytes:
        """Return a picture as it is stored, uint8, luminance (H, W) or BGR (H, W, 3).

        Raises:
            DatasetError: the file cannot be read; the text names it.
        """
        return self._store.picture(int(self._row[index]))

    def luminance(self, index: int) -> Bytes:
        """Return a picture's luminance (H, W), uint8; errors as `picture`."""
        return _luminance(self.picture(index))

    def luminances(self, indices: Iterable[int]) -> list[Bytes]:
        """Return the luminance of each of these pictures."""
        return [self.luminance(int(i)) for i in indices]

    def whole_shards(self) -> Bytes | None:
        """Return all pictures (N, H, W) at once; None: they are single files."""
        return self._store.array("gray", self._row)

    def masks(self) -> Bytes | None:
        """Return where road (1) and junction (2) lie in each picture, (N, M, M); None: unknown."""
        return self._store.array("mask", self._row)

    def where(self, mask: NDArray[np.bool_]) -> "Dataset":
        """Return the pictures for which `mask` (N,) is true."""
        return self.take(np.flatnonzero(mask))

    def take(self, indices: Sequence[int] | NDArray[np.integer]) -> "Dataset":
        """Return the pictures at these indices, in their order."""
        i = np.asarray(indices, np.int64)
        return Dataset(
            self.classes,
            self.label[i],
            self.target[i],
            self.clip[i],
            self.site[i],
            self.split[i],
            self.time_s[i],
            self.info,
            self._store,
            self._row[i],
        )


def sites_of(data: Dataset) -> tuple[NDArray[np.str_], bool]:
    """Return the site of each picture (N,), and whether all are known.

    Unknown ones are taken to be clips, and unknown clips to be single pictures: figures from those
    alone look surer than they are.
    """
    single = np.array([f"picture {i}" for i in range(len(data))], np.str_)
    clips = np.where(data.clip == "", single, data.clip)
    sites = np.where(data.site == "", clips, data.site)
    return np.asarray(sites, np.str_), bool((data.site != "").all())


def open_dataset(path: Path | str) -> Dataset:
    """Return the dataset in the folder `path`.

    Raises:
        DatasetError: it is no dataset; the text says why and what to do.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder; `juncnet dataset extract` makes one")
    if not (folder / INFO).exists():
        return _from_rows(folder, *read_class_folders(folder))
    info = read_info(folder)
    if info.shards:
        return _from_shards(folder, info)
    return _from_rows(folder, info, read_rows(folder, info))


def read_info(folder: Path) -> DatasetInfo:
    """Return what `dataset.json` says; DatasetError where it is not valid."""
    try:
        return DatasetInfo.model_validate_json((folder / INFO).read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise DatasetError(f"{folder / INFO}: {where}: {first['msg']}") from error


def read_rows(folder: Path, info: DatasetInfo) -> list[Row]:
    """Return the lines of `samples.csv`; DatasetError names the line that is not valid."""
    table = folder / TABLE
    if not table.exists():
        raise DatasetError(f"{table} is missing: {INFO} names no shards, so it must be there")
    data = table.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        number = data.count(b"\n", 0, error.start) + 1
        raise DatasetError(f"{table}, line {number}: not UTF-8: save the file as UTF-8") from error
    reader = csv.DictReader(io.StringIO(text, newline=""))
    missing = [c for c in COLUMNS if c not in (reader.fieldnames or ())]
    if missing:
        raise DatasetError(f"{table}: no column {', '.join(missing)}; it needs {COLUMNS}")
    return [_row(table, reader.line_num, line, info) for line in reader]


def write_dataset(folder: Path, info: DatasetInfo, rows: Iterable[Row]) -> None:
    """Write `dataset.json` and `samples.csv` into `folder`; the pictures are the caller's."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / TABLE).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for r in rows:
            time_s = "" if math.isnan(r.time_s) else f"{r.time_s:.3f}"
            writer.writerow([r.path, r.label, r.clip, r.site, r.split, time_s])
    write_info(folder, info)


def write_info(folder: Path, info: DatasetInfo) -> None:
    """Write `dataset.json` into `folder`."""
    (folder / INFO).write_text(info.model_dump_json(indent=2) + "\n", encoding="utf-8")


def _row(table: Path, line_number: int, line: dict[str, str], info: DatasetInfo) -> Row:
    where = f"{table}, line {line_number}"
    if line["class"] not in info.classes:
        known = ", ".join(info.classes)
        raise DatasetError(f"{where}: class {line['class']!r} is none of {known} ({INFO})")
    try:
        split = SPLITS[SPLITS.index(line["split"])]
    except ValueError as error:
        known = ", ".join(SPLITS[1:])
        raise DatasetError(f"{where}: split {line['split']!r} is none of {known}") from error
    try:
        time_s = float(line["time_s"] or "nan")
    except ValueError as error:
        raise DatasetError(f"{where}: time_s {line['time_s']!r} is no number") from error
    return Row(line["path"], line["class"], line["clip"], line["site"], split, time_s)


def _from_rows(folder: Path, info: DatasetInfo, rows: list[Row]) -> Dataset:
    if not rows:
        raise DatasetError(f"{folder}: it has no pictures")
    label = np.array([info.classes.index(row.label) for row in rows], np.int64)
    return Dataset(
        info.classes,
        label,
        np.eye(len(info.classes), dtype=np.float32)[label],
        np.array([row.clip for row in rows], np.str_),
        np.array([row.site for row in rows], np.str_),
        np.array([row.split for row in rows], np.str_),
        np.array([row.time_s for row in rows], np.float64),
        info,
        _Files([folder / row.path for row in rows]),
        np.arange(len(rows)),
    )


def read_class_folders(folder: Path) -> tuple[DatasetInfo, list[Row]]:
    """Return what class folders say.

    A picture in no folder of a site has none, and is a clip of its own.

    Raises:
        DatasetError: there are fewer than two, or a folder's name cannot be a class's.
    """
    pictures = {p.name: found for p in folder.iterdir() if p.is_dir() and (found := _pictures(p))}
    classes = sorted(pictures, key=lambda name: (name != "none", name))
    if len(classes) < 2:
        raise DatasetError(
            f"{folder}: no {INFO}, and fewer than two class folders with pictures; "
            "`juncnet dataset extract` and `juncnet dataset label` make datasets"
        )
    rows: list[Row] = []
    for name in classes:
        for path in pictures[name]:
            inside = path.relative_to(folder / name).parent
            site = inside.as_posix() if inside.name else ""
            clip = site or f"{name}/{path.stem}"
            rows.append(Row(path.relative_to(folder).as_posix(), name, clip, site))
    try:
        return DatasetInfo(classes=tuple(classes), made_by="class folders"), rows
    except ValidationError as error:
        wrong = classes[int(error.errors()[0]["loc"][1])]
        raise DatasetError(
            f"{folder / wrong}: a class is named by letters, digits, '_', '-' and '.': "
            "rename the folder"
        ) from error


def _pictures(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES)


def _from_shards(folder: Path, info: DatasetInfo) -> Dataset:
    arrays: dict[str, list[Bytes]] = {"gray": [], "mask": []}
    label: list[NDArray[np.int64]] = []
    target: list[NDArray[np.float32]] = []
    site: list[NDArray[np.str_]] = []
    for name in info.shards:
        path = folder / name
        try:
            arrays["gray"].append(_mapped(path, "gray"))
            with np.load(path, allow_pickle=False) as data:
                if "mask" in data.files:
                    arrays["mask"].append(_mapped(path, "mask"))
                label.append(data["label"].astype(np.int64))
                target.append(data["target"].astype(np.float32))
                site.append(data["site"].astype(np.str_))
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise DatasetError(f"{path}: not a readable shard: {error}") from error
    labels, wanted, sites = np.concatenate(label), np.concatenate(target), np.concatenate(site)
    labels[labels >= len(info.classes)] = -1
    return Dataset(
        info.classes,
        labels,
        np.stack([1 - wanted, wanted], axis=1) if wanted.ndim == 1 else wanted,
        sites,
        sites,
        np.full(len(labels), "", np.str_),
        np.full(len(labels), math.nan),
        info,
        _Shards(arrays),
        np.arange(len(labels)),
    )


def _mapped(path: Path, name: str) -> Bytes:
    """Return an array of an uncompressed `.npz` as a memory map: nothing is read yet."""
    with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as member:
        if archive.getinfo(f"{name}.npy").compress_type != zipfile.ZIP_STORED:
            raise ValueError("it is compressed; write it with numpy.savez")
        version = npy.read_magic(member)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, fortran, dtype = read(member)
        header = member.tell()
        start = archive.getinfo(f"{name}.npy").header_offset
    if fortran or dtype != np.uint8:
        raise ValueError(f"{name}: needs uint8 in C order, got {dtype}")
    with path.open("rb") as file:
        file.seek(start + 26)  # of the local header: the lengths of its name and extra field
        lengths = int.from_bytes(file.read(2), "little") + int.from_bytes(file.read(2), "little")
    return np.memmap(path, np.uint8, "r", offset=start + 30 + lengths + header, shape=shape)


@dataclass(frozen=True)
class _Files:
    paths: list[Path]

    def picture(self, index: int) -> Bytes:
        path = self.paths[index]
        try:
            data = np.fromfile(path, np.uint8)
        except OSError as error:
            raise DatasetError(f"{path}: {error.strerror}") from error
        picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
        if picture is None or picture.dtype != np.uint8:
            raise DatasetError(
                f"{path}: not a picture that can be read; `juncnet dataset check` lists them all"
            )
        return np.asarray(picture[..., :3] if picture.ndim == 3 else picture, np.uint8)

    def array(self, name: Literal["gray", "mask"], rows: NDArray[np.int64]) -> Bytes | None:
        del name, rows
        return None


class _Shards:
    def __init__(self, arrays: dict[str, list[Bytes]]) -> None:
        self._arrays = arrays
        self._ends = np.cumsum([0, *(len(part) for part in arrays["gray"])])

    def picture(self, index: int) -> Bytes:
        shard = int(np.searchsorted(self._ends, index, side="right")) - 1
        return np.asarray(self._arrays["gray"][shard][index - int(self._ends[shard])])

    def array(self, name: Literal["gray", "mask"], rows: NDArray[np.int64]) -> Bytes | None:
        parts = self._arrays[name]
        if len(parts) + 1 < len(self._ends) or len({part.shape[1:] for part in parts}) > 1:
            return None
        out = np.empty((len(rows), *parts[0].shape[1:]), np.uint8)
        for part, first, end in zip(parts, self._ends, self._ends[1:], strict=False):
            here = (rows >= first) & (rows < end)
            out[here] = part[rows[here] - first]
        return out


def _luminance(picture: Bytes) -> Bytes:
    if picture.ndim == 2:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
