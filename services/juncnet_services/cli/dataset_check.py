"""`juncnet dataset check DIR`: what is in a data set, and what is wrong with it.

Prints counts by class, site and split, writes contact sheets as PNG, and names files that cannot be
read, pictures that the table does not know, empty classes, and leaks between splits: sites and
clips on both sides, near-duplicates across them. Exits 1 when something is wrong.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.learning.datasets import INFO, DatasetError, DatasetInfo, Row, read_info, read_rows
from juncnet.learning.footage.intervals import SPLITS
from juncnet.learning.footage.leaks import Leak, group_leaks, near_duplicate_leaks
from juncnet.learning.footage.likeness import F32, NEAR_DUPLICATE, SIDE, descriptor
from juncnet.learning.footage.sheets import contact_sheet, evenly
from juncnet.learning.footage.writer import PICTURES, SEEN_SITES, SPLIT_BY, SplitBy
from juncnet_services.cli.dataset_counts import counts_table, site_table

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
    info = _info(directory)
    samples = read_rows(directory, info)
    asked: SplitBy = next((s for s in get_args(SplitBy) if s == info.notes.get(SPLIT_BY)), "site")
    descriptors, unreadable = _descriptors(directory, samples)
    readable = [s for s in samples if s.path not in unreadable]
    leaks = group_leaks(samples, asked)
    leaks += near_duplicate_leaks(readable, descriptors, asked, near_duplicate)
    known = {s.path for s in samples}
    there = {
        p.relative_to(directory).as_posix()
        for p in (directory / PICTURES).rglob("*")
        if p.is_file()
    }
    return Report(
        classes=info.classes,
        split_by=asked,
        seen_sites=info.notes.get(SEEN_SITES) == "yes",
        n=len(samples),
        counts=_tally([(s.label, s.split) for s in samples]),
        sites=_tally([(s.site, s.label) for s in samples]),
        unreadable=tuple(unreadable),
        unlisted=tuple(sorted(there - known)),
        problems=tuple(_problems(info, samples)),
        leaks=tuple(leaks),
        sheets=tuple(_write_sheets(directory, readable, sheets)),
    )


def _info(directory: Path) -> DatasetInfo:
    try:
        return read_info(directory)
    except OSError as error:
        raise DatasetError(
            f"{directory} is no data set ({INFO}: {error.strerror}): "
            "`juncnet dataset extract` makes one"
        ) from error


def _tally(pairs: Sequence[tuple[str, str]]) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for (first, second), n in sorted(Counter(pairs).items()):
        counts.setdefault(first, {})[second] = n
    return counts


def _descriptors(directory: Path, samples: Sequence[Row]) -> tuple[F32, list[str]]:
    """Return the descriptors of the readable pictures, and the paths of the others."""
    rows: list[F32] = []
    unreadable: list[str] = []
    for sample in samples:
        gray = _read(directory / sample.path, cv2.IMREAD_GRAYSCALE)
        if gray is None:
            unreadable.append(sample.path)
        else:
            rows.append(descriptor(gray))
    return np.array(rows, np.float32).reshape(-1, SIDE * SIDE), unreadable


def _read(path: Path, how: int) -> NDArray[np.uint8] | None:
    """Return the picture at `path`; None: it is missing, or no whole picture."""
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError:
        return None
    whole = not path.suffix.lower().startswith(".jp") or data[-2:].tobytes() == b"\xff\xd9"
    pixels = cv2.imdecode(data, how) if len(data) and whole else None
    return None if pixels is None else np.asarray(pixels, np.uint8)


def _problems(info: DatasetInfo, samples: Sequence[Row]) -> list[str]:
    found: list[str] = []
    if info.classes[0] != "none":
        found.append(f"the first class is {info.classes[0]!r}: `none` (plain road) must be it")
    twice = [path for path, n in Counter(s.path for s in samples).items() if n > 1]
    found += [f"{path} stands in the table more than once" for path in sorted(twice)]
    if samples and all(s.split == "test" for s in samples):
        return found  # To judge models with, not to train them.
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


def _write_sheets(directory: Path, samples: Sequence[Row], sheets: Path) -> list[str]:
    """Write a contact sheet for each class of each split and return their paths."""
    written: list[str] = []
    for split in SPLITS:
        for label in sorted({s.label for s in samples}):
            rows = [s for s in samples if (s.split, s.label) == (split, label)]
            if not rows:
                continue
            shown = [rows[i] for i in evenly(len(rows), SHEET_CELLS)]
            pictures = [_read(directory / s.path, cv2.IMREAD_COLOR) for s in shown]
            captions = [f"{s.site}  {s.time_s:.1f} s" for s in shown]
            title = f"{label}, {split}: {len(shown)} of {len(rows)}"
            pairs = [(p, c) for p, c in zip(pictures, captions, strict=True) if p is not None]
            sheet = contact_sheet(title, [p for p, _ in pairs], [c for _, c in pairs])
            path = sheets / f"{split}-{label}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(cv2.imencode(".png", sheet)[1].tobytes())
            written.append(str(path))
    return written


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
    parser.add_argument("--sheets", type=Path, metavar="DIR", help="(default: DIR/check)")
    parser.add_argument(
        "--near-duplicate",
        type=float,
        default=NEAR_DUPLICATE,
        metavar="D",
        help=f"pictures on two sides that differ less are a leak ({NEAR_DUPLICATE})",
    )
    parser.add_argument("--json", action="store_true", help="the report as one object")
    options = parser.parse_args(argv)
    sheets = options.sheets or options.directory / "check"
    try:
        report = examine(options.directory, sheets, options.near_duplicate)
    except DatasetError as error:
        print(f"juncnet dataset check: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps({**asdict(report), "sound": report.sound}, indent=2))
    else:
        rows = read_rows(options.directory, _info(options.directory))
        print(text(options.directory, rows, report))
    return 0 if report.sound else 1
