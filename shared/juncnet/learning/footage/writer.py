"""Writes a data set from footage, picture by picture; the format is `juncnet.learning.datasets`.

`notes` of its `dataset.json` say `split_by` (site, clip or frame) and `seen_sites` (yes: a site
stands in more than one split, so every figure is one of *seen sites*; else no).
"""

import math
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from juncnet.learning.datasets import DatasetInfo, Row, Split, write_dataset
from juncnet.learning.footage.intervals import SPLITS, FootageError

PICTURES = "pictures"
SPLIT_BY, SEEN_SITES = "split_by", "seen_sites"

SplitBy = Literal["site", "clip", "frame"]


def sites_in_several_splits(rows: Iterable[Row]) -> dict[str, tuple[str, ...]]:
    """Return the sites that stand in more than one split, with those splits."""
    return _in_several_splits((row.site, row.split) for row in rows)


def clips_in_several_splits(rows: Iterable[Row]) -> dict[str, tuple[str, ...]]:
    """Return the clips that stand in more than one split, with those splits."""
    return _in_several_splits((row.clip, row.split) for row in rows)


def _in_several_splits(pairs: Iterable[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    splits: dict[str, set[str]] = {}
    for group, split in pairs:
        if group and split:
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
        self.rows: list[Row] = []
        """Of the pictures so far; their splits are those asked for, or empty."""
        self._paths: set[str] = set()

    def add(self, picture: bytes, suffix: str, row: Row) -> None:
        """Keep an encoded picture as `pictures/CLASS/CLIP-TIME.SUFFIX`; `row.path` is unused."""
        stem = row.clip.replace("/", "_").rsplit(".", 1)[0]
        milliseconds = 0 if math.isnan(row.time_s) else round(1000 * row.time_s)
        name = f"{PICTURES}/{row.label}/{stem}-{milliseconds:07d}"
        path, number = f"{name}.{suffix}", 1
        while path in self._paths:
            number += 1
            path = f"{name}-{number}.{suffix}"
        self._paths.add(path)
        target = self.directory / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(picture)
        self.rows.append(replace(row, path=path))

    def keep_only(self, indices: Sequence[int]) -> None:
        """Remove all pictures but those of these indices of `rows`."""
        kept = set(indices)
        for index, row in enumerate(self.rows):
            if index not in kept:
                (self.directory / row.path).unlink()
        self.rows = [row for index, row in enumerate(self.rows) if index in kept]

    def discard(self) -> None:
        """Remove the pictures written so far: nothing is left but an empty folder."""
        shutil.rmtree(self.directory / PICTURES, ignore_errors=True)

    def finish(
        self,
        splits: Sequence[Split],
        classes: tuple[str, ...],
        made_by: str,
        split_by: SplitBy,
        notes: Mapping[str, str],
    ) -> None:
        """Write the table with the split of every picture, and the header with what it shows."""
        self.rows = [replace(r, split=split) for r, split in zip(self.rows, splits, strict=True)]
        seen = "yes" if sites_in_several_splits(self.rows) else "no"
        said = {SPLIT_BY: split_by, SEEN_SITES: seen, **notes}
        info = DatasetInfo(classes=classes, made_by=made_by, notes=said)
        write_dataset(self.directory, info, self.rows)


def write_atomically(path: Path, text: str) -> None:
    """Replace the file at `path`: whoever reads it, whatever dies, sees the old or the new text."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    with part.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
