"""`juncnet dataset extract VIDEOS --out DIR`: frames from videos, as a data set.

Labels come from folders (VIDEOS/CLASS/clip.mp4 or VIDEOS/CLASS/SITE/clip.mp4), or with --labels
from an interval file (`clip, from, to, class` and, where wanted, `site, split`), such as
`juncnet dataset label` writes. What no interval holds is left out, or is --rest.
"""

import argparse
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from juncnet.learning.datasets import Row, Split
from juncnet.learning.footage.intervals import SPLITS, FootageError, classes_of, interval_at
from juncnet.learning.footage.leaks import twins_across
from juncnet.learning.footage.likeness import F32, NEAR_DUPLICATE, Novelty, descriptor
from juncnet.learning.footage.pixels import as_stored, jpeg
from juncnet.learning.footage.sides import Rules, clips_asked_for, sides, within
from juncnet.learning.footage.splits import FRACTIONS, parse_shares
from juncnet.learning.footage.writer import DatasetWriter
from juncnet_services.cli.dataset.clips import Clip, clips_by_folders, clips_by_intervals
from juncnet_services.cli.dataset.counts import counts_table
from juncnet_services.cli.dataset.videos import Video, whole_frame

MARGIN = 0.03
"""Pictures across splits must differ by this much more: `check` sees them as JPEG."""


@dataclass(frozen=True)
class Sampling:
    """Which frames are kept of what is labelled, and how large."""

    every_s: float
    near_duplicate: float
    height: int


class Extraction:
    """Takes frames from clips into a data set."""

    def __init__(self, out: Path, sampling: Sampling) -> None:
        """Begin in the new folder `out`.

        Raises:
            FootageError: something is in it already.
        """
        self.writer, self._sampling = DatasetWriter(out), sampling
        self._descriptors: list[F32] = []
        self._skipped = 0

    def run(self, clips: Sequence[Clip], rules: Rules, limit: int | None, command: str) -> None:
        """Write the whole data set; whatever stops this leaves the folder empty.

        Raises:
            FootageError: as `add` and `finish`.
        """
        _classes(label for clip in clips for label in _labels(clip))
        clips_asked_for({(clip.name, clip.site) for clip in clips}, rules)
        _check_readable(clips)
        try:
            for number, clip in enumerate(clips, 1):
                print(f"{number}/{len(clips)} {clip.name}: {self.add(clip)} frames", flush=True)
            self.finish(rules, limit, command)
        except BaseException:
            self.writer.discard()
            raise

    def add(self, clip: Clip) -> int:
        """Add the frames of a clip and return how many there were.

        Raises:
            FootageError: the video cannot be read.
        """
        video, novelty = Video(clip.path), Novelty(self._sampling.near_duplicate)
        next_s, before = 0.0, len(self.writer.rows)
        for index, decoded in video.frames():
            time_s = video.times_s[index]
            interval = interval_at(clip.intervals, time_s)
            label = interval.label if interval else clip.label
            if label is None or time_s < next_s - 1e-6:
                continue
            next_s = time_s + self._sampling.every_s
            frame = whole_frame(decoded)
            seen = descriptor(frame.luminance())
            if not novelty.keep(seen):
                self._skipped += 1
                continue
            row = Row("", label, clip.name, clip.site, interval.split if interval else "", time_s)
            self.writer.add(jpeg(as_stored(frame, self._sampling.height)), "jpg", row)
            self._descriptors.append(seen)
        if video.counts.corrupt:
            text = f"  {clip.name}: {video.counts.corrupt} damaged pictures left out"
            print(text, file=sys.stderr)
        return len(self.writer.rows) - before

    def finish(self, rules: Rules, limit: int | None, command: str) -> None:
        """Thin out, deal out and write the table.

        Raises:
            FootageError: too little is labelled, or the splits cannot be filled.
        """
        classes = _classes(row.label for row in self.writer.rows)
        self._keep(within(self.writer.rows, rules, limit))
        splits = sides(self.writer.rows, rules)
        twins = set[int]()
        if rules.split_by != "frame" and self._sampling.near_duplicate > 0:
            limit_apart = self._sampling.near_duplicate + MARGIN
            twins = twins_across(splits, np.array(self._descriptors), limit_apart)
            self._keep([i for i in range(len(splits)) if i not in twins])
        notes = {
            "every_s": f"{self._sampling.every_s:g}",
            "near_duplicates": f"of difference below {self._sampling.near_duplicate:g}: "
            f"{self._skipped} within clips and {len(twins)} across splits left out",
            "limit": "none" if limit is None else str(limit),
        }
        kept: list[Split] = [split for i, split in enumerate(splits) if i not in twins]
        self.writer.finish(kept, classes, command, rules.split_by, notes)

    def _keep(self, indices: Sequence[int]) -> None:
        self.writer.keep_only(indices)
        self._descriptors = [self._descriptors[i] for i in indices]


def _check_readable(clips: Sequence[Clip]) -> None:
    """Look at all clips before the first is decoded, which takes long.

    Raises:
        FootageError: some cannot be read; the text names all of them.
    """
    wrong: list[str] = []
    for clip in clips:
        try:
            Video(clip.path)
        except FootageError as error:
            wrong.append(str(error))
    if wrong:
        many = f"{len(wrong)} of {len(clips)} videos: " if len(wrong) > 1 else ""
        raise FootageError(many + "; ".join(wrong))


def _labels(clip: Clip) -> list[str]:
    """Return the classes that a clip is said to show."""
    rest = [] if clip.label is None else [clip.label]
    return [*rest, *(interval.label for interval in clip.intervals)]


def _classes(found: Iterable[str]) -> tuple[str, ...]:
    labels = set(found)
    if len(labels) < 2:
        raise FootageError(
            f"only {', '.join(labels) or 'nothing'} was found: a data set needs two classes, "
            "one of them `none` (plain road)"
        )
    if "none" not in labels:
        raise FootageError(f"no class is called `none` (plain road): {', '.join(sorted(labels))}")
    return classes_of(labels)


def _check_pattern(pattern: str | None) -> None:
    try:
        re.compile(pattern or "")
    except re.error as error:
        raise FootageError(f"--site-from {pattern!r} is no regular expression: {error}") from error


def main(argv: list[str]) -> int:
    """Extract frames; 2 when something given is wrong."""
    options = _parser().parse_args(argv)
    try:
        _check_pattern(options.site_from)
        rules = Rules(
            split_by="frame" if options.seen_sites else options.split_by,
            shares=parse_shares(options.shares),
            validation=tuple(options.validation),
            test=tuple(options.test),
            seed=options.seed,
        )
        if options.labels:
            root = options.videos or options.labels.parent
            clips = clips_by_intervals(options.labels, root, options.rest, options.site_from)
        elif options.videos:
            clips = clips_by_folders(options.videos, options.site_from)
        else:
            raise FootageError("name a folder of class folders, or an interval file with --labels")
        sampling = Sampling(options.every, options.near_duplicate, options.height)
        few = options.limit is not None and options.limit < 2
        if sampling.every_s < 0 or sampling.height < 16 or few:
            raise FootageError(
                "--every must not be negative, --height 16 or more, --limit 2 or more"
            )
        command = shlex.join(["juncnet", "dataset", "extract", *argv])
        extraction = Extraction(options.out, sampling)
        extraction.run(clips, rules, options.limit, command)
    except FootageError as error:
        print(f"juncnet dataset extract: {error}", file=sys.stderr)
        return 2
    rows = extraction.writer.rows
    print(counts_table(rows))
    print(f"wrote {len(rows)} frames to {options.out}; look at them with "
          f"`juncnet dataset check {options.out}`")  # fmt: skip
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="juncnet dataset extract",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("videos", nargs="?", type=Path, metavar="VIDEOS", help="the folder with the videos")
    add("--out", type=Path, required=True, metavar="DIR", help="the data set, a new folder")
    add("--labels", type=Path, metavar="FILE", help="the interval file")
    add("--rest", metavar="CLASS", help="with --labels: what no interval holds is of this class")
    add("--every", type=float, default=0.2, metavar="S", help="seconds between frames (0.2)")
    add(
        "--near-duplicate",
        type=float,
        default=NEAR_DUPLICATE,
        metavar="D",
        help=f"skip frames that differ less from one kept before ({NEAR_DUPLICATE}; 0: keep all)",
    )
    add(
        "--limit",
        type=int,
        metavar="N",
        help="at most N frames to learn from, all clips alike; --test is not counted",
    )
    add("--height", type=int, default=360, metavar="PX", help="of the kept pictures (360)")
    add("--site-from", metavar="REGEX", help="its first group in a clip's name is the clip's site")
    add("--split-by", choices=("site", "clip"), default="site", help="what is dealt out (site)")
    add(
        "--seen-sites",
        action="store_true",
        help="deal out single frames as the paper does: train and test show the same places",
    )
    shares = ",".join(f"{100 * f:g}" for f in FRACTIONS)
    add("--shares", default=shares, metavar="A,B,C", help=f"of {', '.join(SPLITS)} ({shares})")
    for split in SPLITS[1:]:
        text = f"sites or clips for {split}; * stands for anything"
        add(f"--{split}", nargs="+", default=[], metavar="NAME", help=text)
    add("--seed", type=int, default=0, help="of what is drawn")
    return parser
