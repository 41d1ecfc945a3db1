"""`juncnet dataset extract VIDEOS --out DIR`: frames from videos, as a data set.

Labels come from folders (VIDEOS/CLASS/clip.mp4 or VIDEOS/CLASS/SITE/clip.mp4), or with --labels
from an interval file (`clip, from, to, class` and, where wanted, `site, split`), such as
`juncnet dataset label` writes. What no interval holds is left out, or is --rest.
"""

import argparse
import re
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from juncnet.learning.datasets import Row
from juncnet.learning.footage.intervals import (
    SPLITS,
    FootageError,
    Interval,
    classes_of,
    interval_at,
    read_intervals,
)
from juncnet.learning.footage.likeness import NEAR_DUPLICATE, Novelty
from juncnet.learning.footage.pixels import as_stored, jpeg
from juncnet.learning.footage.selection import thinned
from juncnet.learning.footage.sides import Rules, sides
from juncnet.learning.footage.splits import FRACTIONS, parse_shares
from juncnet.learning.footage.writer import DatasetWriter
from juncnet_services.cli.dataset_counts import counts_table
from juncnet_services.cli.dataset_videos import Video, clip_names, videos_in, whole_frame


@dataclass(frozen=True)
class Clip:
    """A video and what is said about it."""

    name: str
    path: Path
    site: str
    label: str | None
    """Of the whole clip, or of what no interval holds; None: left out."""
    intervals: tuple[Interval, ...] = ()


@dataclass(frozen=True)
class Sampling:
    """Which frames are kept of what is labelled, and how large."""

    every_s: float
    near_duplicate: float
    height: int


def clips_by_folders(root: Path, site_pattern: str | None) -> list[Clip]:
    """Return the clips of a folder of class folders.

    Raises:
        FootageError: a video is in no class folder.
    """
    clips: list[Clip] = []
    for name, path in clip_names(videos_in(root), root).items():
        parts = name.split("/")
        if len(parts) < 2:
            raise FootageError(
                f"{path} is in no class folder: move it to {root}/none/ or {root}/junction/, "
                "or say what it shows with --labels (`juncnet dataset label` writes the file)"
            )
        site = parts[-2] if len(parts) > 2 else path.stem
        clips.append(Clip(name, path, site_of(name, site_pattern, site), parts[0]))
    return clips


def clips_by_intervals(
    labels: Path, root: Path, rest: str | None, site_pattern: str | None
) -> list[Clip]:
    """Return the clips that an interval file names; videos are looked for below `root`.

    Raises:
        FootageError: the file is wrong, or names a video that is not there.
    """
    try:
        text = labels.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FootageError(f"{labels} cannot be read: {error}") from error
    intervals = read_intervals(text, str(labels))
    known = clip_names(videos_in(root), root)
    clips: dict[str, list[Interval]] = {}
    for interval in intervals:
        clips.setdefault(_find(interval.clip, known, labels), []).append(interval)
    found: list[Clip] = []
    for name, said in clips.items():
        told = {i.site for i in said if i.site}
        if len(told) > 1:
            raise FootageError(f"{labels}: {name} has several sites: {', '.join(sorted(told))}")
        parent = name.split("/")[-2] if "/" in name else known[name].stem
        site = next(iter(told), "") or site_of(name, site_pattern, parent)
        found.append(Clip(name, known[name], site, rest, tuple(said)))
    return found


def _find(clip: str, known: dict[str, Path], labels: Path) -> str:
    """Return the name among `known` that an interval file means by `clip`."""
    matching = [n for n in known if n == clip] or [n for n in known if n.endswith("/" + clip)]
    if len(matching) == 1:
        return matching[0]
    problem = "is not among the videos" if not matching else "could be " + " or ".join(matching)
    there = ", ".join(list(known)[:5])
    raise FootageError(f"{labels}: clip {clip!r} {problem} (there: {there}, ...)")


def site_of(name: str, pattern: str | None, otherwise: str) -> str:
    """Return the site that a clip's name tells by the first group of `pattern`."""
    if pattern is None:
        return otherwise
    match = re.search(pattern, name)
    if match is None or match.lastindex is None:
        raise FootageError(
            f"--site-from {pattern!r} finds no group in {name!r}: try it on the names of all clips"
        )
    return match.group(1)


def add_clip(writer: DatasetWriter, clip: Clip, sampling: Sampling) -> int:
    """Add the frames of a clip to the data set and return how many near-duplicates were skipped.

    Raises:
        FootageError: the video cannot be read.
    """
    video, novelty = Video(clip.path), Novelty(sampling.near_duplicate)
    next_s, skipped = 0.0, 0
    for index, decoded in video.frames():
        time_s = video.times_s[index]
        if time_s < next_s - 1e-6:
            continue
        interval = interval_at(clip.intervals, time_s)
        label = interval.label if interval else clip.label
        if label is None:
            continue
        next_s = time_s + sampling.every_s
        frame = whole_frame(decoded)
        if not novelty.keep(frame.luminance()):
            skipped += 1
            continue
        split = interval.split if interval else ""
        sample = Row("", label, clip.name, clip.site, split, time_s)
        writer.add(jpeg(as_stored(frame, sampling.height)), "jpg", sample)
    if video.counts.corrupt:
        print(f"  {clip.name}: {video.counts.corrupt} damaged pictures left out", file=sys.stderr)
    return skipped


def extract(
    clips: Sequence[Clip],
    out: Path,
    sampling: Sampling,
    rules: Rules,
    limit: int | None,
    command: str,
) -> DatasetWriter:
    """Write the data set of `clips` to `out` and return its writer.

    Raises:
        FootageError: a video cannot be read, nothing is labelled, or the splits cannot be filled.
    """
    writer, skipped = DatasetWriter(out), 0
    for number, clip in enumerate(clips, 1):
        before = len(writer.rows)
        skipped += add_clip(writer, clip, sampling)
        print(f"{number}/{len(clips)} {clip.name}: {len(writer.rows) - before} frames")
    labels = {sample.label for sample in writer.rows}
    if len(labels) < 2:
        raise FootageError(
            f"only {', '.join(labels) or 'nothing'} was found: a data set needs two classes, "
            "one of them `none` (plain road)"
        )
    if "none" not in labels:
        raise FootageError(f"no class is called `none` (plain road): {', '.join(sorted(labels))}")
    if limit is not None:
        writer.keep_only(thinned(writer.rows, limit))
    notes = {
        "every_s": f"{sampling.every_s:g}",
        "near_duplicates": f"{skipped} skipped, of difference below {sampling.near_duplicate:g}",
        "limit": "none" if limit is None else str(limit),
    }
    splits = sides(writer.rows, rules)
    writer.finish(splits, classes_of(labels), command, rules.split_by, notes)
    return writer


def main(argv: list[str]) -> int:
    """Extract frames; 2 when something given is wrong."""
    options = _parser().parse_args(argv)
    try:
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
        command = shlex.join(["juncnet", "dataset", "extract", *argv])
        writer = extract(clips, options.out, sampling, rules, options.limit, command)
    except (FootageError, re.error) as error:
        print(f"juncnet dataset extract: {error}", file=sys.stderr)
        return 2
    print(counts_table(writer.rows))
    print(f"wrote {len(writer.rows)} frames to {options.out}; look at them with "
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
    add("--limit", type=int, metavar="N", help="keep at most N frames, all classes and clips alike")
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
