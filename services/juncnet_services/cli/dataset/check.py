"""`juncnet dataset check DIR`: what is in a data set, and what is wrong with it.

Prints counts by class, site and split, writes contact sheets as PNG, and names files that cannot be
read, pictures that the table does not know, empty classes, and leaks between splits: sites and
clips on both sides, near-duplicates across them. Exits 1 when something is wrong.
"""

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath
from typing import get_args

import cv2
import numpy as np

from juncnet.learning.datasets import INFO, DatasetError, DatasetInfo, Row
from juncnet.learning.footage.intervals import SPLITS
from juncnet.learning.footage.leaks import Leak, group_leaks, near_duplicate_leaks
from juncnet.learning.footage.likeness import F32, NEAR_DUPLICATE, SIDE, descriptor
from juncnet.learning.footage.sheets import contact_sheet, evenly
from juncnet.learning.footage.writer import SEEN_SITES, SPLIT_BY, SplitBy
from juncnet_services.cli.dataset.contents import Contents
from juncnet_services.cli.dataset.counts import UNDECIDED, counts_table, site_table

SHEET_CELLS = 60
SHOWN = 12


@dataclass(frozen=True)
class Report:
    """What a check found."""

    classes: tuple[str, ...]
    split_by: str
    seen_sites: bool
    n: int
    counts: dict[str, dict[str, int]]
    """Pictures by class and split."""
    sites: dict[str, dict[str, int]]
    """Pictures by site and class."""
    unreadable: tuple[str, ...]
    unlisted: tuple[str, ...]
    """Pictures in the folder that the table does not know."""
    problems: tuple[str, ...]
    leaks: tuple[Leak, ...]
    sheets: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong; leaks that the data set was asked to have are not."""
        wrong = [leak for leak in self.leaks if not leak.asked_for]
        return not (self.unreadable or self.unlisted or self.problems or wrong)


def examine(directory: Path, sheets: Path, near_duplicate: float = NEAR_DUPLICATE) -> Report:
    """Return what is to be said about the data set in `directory`; contact sheets go to `sheets`.

    Raises:
        DatasetError: it is no data set, or a line of its table is wrong.
    """
    contents = Contents(directory)
    info, rows = contents.info, contents.rows
    asked: SplitBy = next((s for s in get_args(SplitBy) if s == info.notes.get(SPLIT_BY)), "site")
    descriptors, unreadable = _descriptors(contents)
    readable = [row for index, row in enumerate(rows) if index not in unreadable]
    leaks = group_leaks(rows, asked)
    leaks += near_duplicate_leaks(readable, descriptors, asked, near_duplicate)
    return Report(
        classes=info.classes,
        split_by=asked,
        seen_sites=info.notes.get(SEEN_SITES) == "yes",
        n=len(rows),
        counts=_tally([(row.label, row.split) for row in rows]),
        sites=_tally([(row.site, row.label) for row in rows]),
        unreadable=tuple(rows[index].path for index in sorted(unreadable)),
        unlisted=tuple(contents.unlisted),
        problems=tuple(_problems(info, rows)),
        leaks=tuple(leaks),
        sheets=tuple(_write_sheets(contents, unreadable, sheets)),
    )


def _tally(pairs: Sequence[tuple[str, str]]) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for (first, second), n in sorted(Counter(pairs).items()):
        counts.setdefault(first, {})[second] = n
    return counts


def _descriptors(contents: Contents) -> tuple[F32, set[int]]:
    """Return the descriptors of the readable pictures, and the indices of the others."""
    found: list[F32] = []
    unreadable: set[int] = set()
    for index in range(len(contents.rows)):
        gray = contents.luminance(index)
        if gray is None:
            unreadable.add(index)
        else:
            found.append(descriptor(gray))
    return np.array(found, np.float32).reshape(-1, SIDE * SIDE), unreadable


def _problems(info: DatasetInfo, samples: Sequence[Row]) -> list[str]:
    found: list[str] = []
    if not samples:
        found.append("there are no pictures: label more, or extract with a larger --limit")
    if info.classes[0] != "none":
        found.append(f"the first class is {info.classes[0]!r}: `none` (plain road) must be it")
    twice = [path for path, n in Counter(s.path for s in samples).items() if n > 1]
    found += [f"{path} stands in the table more than once" for path in sorted(twice)]
    if {s.split for s in samples} <= {"test"} or not any(s.split for s in samples):
        return found  # To judge models with; or whoever trains deals out.
    have = Counter((s.split, s.label) for s in samples)
    for split in SPLITS:
        if not any(s.split == split for s in samples):
            if split != "test":
                found.append(f"{split} is empty: extract with other --shares or --split-by clip")
            continue
        found += [
            f"no picture of {name!r} in {split}: name sites or clips with --{split}, "
            "or extract with --split-by clip"
            for name in info.classes
            if not have[split, name]
        ]
    return found


def _write_sheets(contents: Contents, unreadable: set[int], sheets: Path) -> list[str]:
    """Write a contact sheet for each class of each split and return their paths."""
    groups: dict[tuple[str, str], list[int]] = {}
    for index, row in enumerate(contents.rows):
        if index not in unreadable:
            groups.setdefault((row.split or UNDECIDED, row.label), []).append(index)
    written: list[str] = []
    for (split, label), indices in sorted(groups.items()):
        shown = [indices[i] for i in evenly(len(indices), SHEET_CELLS)]
        pictures = [contents.picture(index) for index in shown]
        pairs = [(p, i) for p, i in zip(pictures, shown, strict=True) if p is not None]
        title = f"{label}, {split}: {len(shown)} of {len(indices)}"
        captions = [_caption(contents.rows[i]) for _, i in pairs]
        sheet = contact_sheet(title, [p for p, _ in pairs], captions)
        path = sheets / f"{split}-{label}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(cv2.imencode(".png", sheet)[1].tobytes())
        written.append(str(path))
    return written


def _caption(row: Row) -> str:
    clip = str(PurePath(row.clip).with_suffix("")) if row.clip else row.site
    return clip if math.isnan(row.time_s) else f"{clip}  {row.time_s:.1f} s"


def text(directory: Path, samples: Sequence[Row], report: Report) -> str:
    """Return what `report` says, for people."""
    lines = [counts_table(samples), "", site_table(samples), ""]
    if report.seen_sites:
        lines.append("seen sites: the same places stand in several splits, as it was asked for")
    lines += [f"unreadable: {directory / path}" for path in report.unreadable]
    lines += [f"not in samples.csv: {directory / path}" for path in report.unlisted]
    lines += [f"problem: {problem}" for problem in report.problems]
    for kind in ("site", "clip", "near_duplicate"):
        leaks = [leak for leak in report.leaks if leak.kind == kind]
        wrong = sum(not leak.asked_for for leak in leaks)
        if leaks:
            lines.append(
                f"{kind.replace('_', '-')}s on more than one side: {len(leaks)}"
                + ("" if wrong else " (asked for)")
            )
        for leak in leaks[:SHOWN]:
            apart = "" if leak.difference is None else f", difference {leak.difference:.2f}"
            lines.append(f"  {leak.what}: {' and '.join(leak.splits)}{apart}")
        if len(leaks) > SHOWN:
            lines.append(f"  and {len(leaks) - SHOWN} more (--json lists them all)")
    lines += [f"contact sheet: {path}" for path in report.sheets]
    lines.append("sound" if report.sound else "NOT sound: see above")
    return "\n".join(lines)


def main(argv: list[str]) -> int:
    """Check a data set; 1 when something is wrong with it, 2 when it is none."""
    parser = argparse.ArgumentParser(
        prog="juncnet dataset check",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("directory", type=Path, metavar="DIR")
    parser.add_argument(
        "--sheets", type=Path, metavar="DIR", help="(default: beside it, DIR-check)"
    )
    parser.add_argument(
        "--near-duplicate",
        type=float,
        default=NEAR_DUPLICATE,
        metavar="D",
        help=f"pictures on two sides that differ less are a leak ({NEAR_DUPLICATE})",
    )
    parser.add_argument("--json", action="store_true", help="the report as one object")
    options = parser.parse_args(argv)
    folder = options.directory.resolve()
    sheets: Path = options.sheets or folder.with_name(f"{folder.name}-check")
    try:
        if not (folder / INFO).exists() and sheets.resolve().is_relative_to(folder):
            raise DatasetError(
                f"--sheets {sheets}: sheets among class folders would be a class: name another"
            )
        report = examine(options.directory, sheets, options.near_duplicate)
    except DatasetError as error:
        print(f"juncnet dataset check: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps({**asdict(report), "sound": report.sound}, indent=2))
    else:
        print(text(options.directory, Contents(options.directory).rows, report))
    return 0 if report.sound else 1
