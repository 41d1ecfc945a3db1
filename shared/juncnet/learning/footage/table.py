"""A data set on disk: `dataset.json`, `samples.csv` and pictures.

`dataset.json` tells the classes and how the set was made; `samples.csv` has one row a picture with
the columns `path` (relative to the folder, with `/`), `class`, `clip`, `site`, `split` and
`time_s` (in the clip; empty: unknown). Further columns may follow.
"""

import csv
import io
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from juncnet.learning.footage.intervals import SPLITS, FootageError

HEADER = "dataset.json"
TABLE = "samples.csv"
PICTURES = "pictures"
COLUMNS = ("path", "class", "clip", "site", "split", "time_s")

SplitBy = Literal["site", "clip", "frame"]


class DatasetHeader(BaseModel):
    """The content of `dataset.json`."""

    model_config = ConfigDict(frozen=True, extra="allow")

    format: Literal[1] = 1
    classes: tuple[str, ...] = Field(min_length=2)
    """In the order of a model's outputs; `none` is the first."""
    split_by: SplitBy = "site"
    """What was dealt out to the splits."""
    seen_sites: bool = False
    """Whether a site stands in more than one split: then every figure is one of *seen sites*."""
    made: dict[str, Any] = Field(default_factory=dict[str, Any])
    """How: command, sources, rules."""


@dataclass(frozen=True)
class Sample:
    """A row of `samples.csv`."""

    path: str
    label: str
    clip: str
    site: str
    split: str = ""
    """`train`, `validation` or `test`; empty: not dealt out yet."""
    time_s: float = math.nan
    """In the clip; NaN: unknown."""


def read_header(directory: Path) -> DatasetHeader:
    """Return the header of the data set in `directory`.

    Raises:
        FootageError: there is none, or a field of it is wrong.
    """
    path = directory / HEADER
    try:
        return DatasetHeader.model_validate_json(path.read_bytes())
    except OSError as error:
        raise FootageError(
            f"{path} cannot be read ({error.strerror}): is {directory} a data set? "
            "`juncnet dataset extract` makes one"
        ) from error
    except ValidationError as error:
        problems = "; ".join(
            f"{'.'.join(map(str, p['loc'])) or 'content'}: {p['msg']}"
            for p in error.errors(include_url=False)
        )
        raise FootageError(f"{path}: {problems}") from error


def read_samples(directory: Path) -> list[Sample]:
    """Return the rows of the data set in `directory`; columns beyond ours are left out.

    Raises:
        FootageError: the table is missing or a row of it is wrong; the text says which.
    """
    path = directory / TABLE
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FootageError(f"{path} cannot be read: {error}") from error
    reader = csv.DictReader(io.StringIO(text))
    missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise FootageError(f"{path}: no column {', '.join(missing)}")
    rows: list[Sample] = []
    for values in reader:
        try:
            rows.append(_sample(values))
        except ValueError as error:
            raise FootageError(f"{path}, line {reader.line_num}: {error}") from error
    return rows


def _sample(values: Mapping[str, str | None]) -> Sample:
    path, label, clip, site, split, time_s = (values[name] or "" for name in COLUMNS)
    if not path or not label:
        raise ValueError("path or class is empty")
    if split not in SPLITS:
        raise ValueError(f"split {split!r} is none of {', '.join(SPLITS)}")
    return Sample(path, label, clip, site, split, float(time_s) if time_s else math.nan)


def table_text(samples: Iterable[Sample]) -> str:
    """Return the text of `samples.csv`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for s in samples:
        time_s = "" if math.isnan(s.time_s) else f"{s.time_s:.3f}"
        writer.writerow((s.path, s.label, s.clip, s.site, s.split, time_s))
    return out.getvalue()


def sites_in_several_splits(samples: Iterable[Sample]) -> dict[str, tuple[str, ...]]:
    """Return the sites that stand in more than one split, with those splits."""
    return _in_several_splits((s.site, s.split) for s in samples)


def clips_in_several_splits(samples: Iterable[Sample]) -> dict[str, tuple[str, ...]]:
    """Return the clips that stand in more than one split, with those splits."""
    return _in_several_splits((s.clip, s.split) for s in samples)


def _in_several_splits(pairs: Iterable[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    splits: dict[str, set[str]] = {}
    for group, split in pairs:
        if group:
            splits.setdefault(group, set()).add(split)
    return {
        group: tuple(s for s in SPLITS if s in found)
        for group, found in sorted(splits.items())
        if len(found) > 1
    }


class DatasetWriter:
    """Writes a data set: pictures as they come, table and header at the end.

    A folder without `dataset.json` is no data set, so one that was broken off is not mistaken for
    a whole one.
    """

    def __init__(self, directory: Path) -> None:
        """Begin in `directory`.

        Raises:
            FootageError: something is in it already.
        """
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise FootageError(
                f"{directory} is not empty: name another folder with --out, or remove it"
            )
        self.directory = directory
        self.samples: list[Sample] = []
        """Of the pictures so far; their splits are those asked for, or empty."""
        self._paths: set[str] = set()

    def add(self, picture: bytes, suffix: str, sample: Sample) -> None:
        """Keep an encoded picture as `pictures/CLASS/CLIP-TIME.SUFFIX`; `sample.path` is unused."""
        stem = sample.clip.replace("/", "_").rsplit(".", 1)[0]
        milliseconds = 0 if math.isnan(sample.time_s) else round(1000 * sample.time_s)
        name = f"{PICTURES}/{sample.label}/{stem}-{milliseconds:07d}"
        path, number = f"{name}.{suffix}", 1
        while path in self._paths:
            number += 1
            path = f"{name}-{number}.{suffix}"
        self._paths.add(path)
        target = self.directory / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(picture)
        self.samples.append(replace(sample, path=path))

    def keep_only(self, indices: Sequence[int]) -> None:
        """Remove all pictures but those of these indices of `samples`."""
        kept = set(indices)
        for index, sample in enumerate(self.samples):
            if index not in kept:
                (self.directory / sample.path).unlink()
        self.samples = [s for index, s in enumerate(self.samples) if index in kept]

    def finish(self, splits: Sequence[str], header: DatasetHeader) -> None:
        """Write the table with the split of every picture, then the header.

        `seen_sites` of the header is set to what the table says.
        """
        rows = [replace(s, split=w) for s, w in zip(self.samples, splits, strict=True)]
        seen = bool(sites_in_several_splits(rows))
        write_atomically(self.directory / TABLE, table_text(rows))
        header = header.model_copy(update={"seen_sites": seen})
        write_atomically(self.directory / HEADER, header.model_dump_json(indent=2) + "\n")
        self.samples = rows


def write_atomically(path: Path, text: str) -> None:
    """Replace the file at `path`: whoever reads it, whatever dies, sees the old or the new text."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    with part.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
