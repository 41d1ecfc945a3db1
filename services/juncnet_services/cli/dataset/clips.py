"""The clips that frames are taken from: their videos, sites, and what is said about them."""

import re
from dataclasses import dataclass
from pathlib import Path

from juncnet.learning.footage.intervals import (
    FootageError,
    Interval,
    check_name,
    read_intervals,
)
from juncnet_services.cli.dataset.videos import clip_names, videos_in


@dataclass(frozen=True)
class Clip:
    """A video and what is said about it."""

    name: str
    path: Path
    site: str
    label: str | None
    """Of the whole clip, or of what no interval holds; None: left out."""
    intervals: tuple[Interval, ...] = ()


def clips_by_folders(root: Path, site_pattern: str | None) -> list[Clip]:
    """Return the clips of a folder of class folders.

    Raises:
        FootageError: a video is in no class folder, or in one that no class may be called.
    """
    clips: list[Clip] = []
    for name, path in clip_names(videos_in(root), root).items():
        parts = name.split("/")
        if len(parts) < 2:
            raise FootageError(
                f"{path} is in no class folder: move it to {root}/none/ or {root}/junction/, "
                "or say what it shows with --labels (`juncnet dataset label` writes the file)"
            )
        check_name(parts[0])
        site = parts[-2] if len(parts) > 2 else path.stem
        clips.append(Clip(name, path, site_of(name, site_pattern, site), parts[0]))
    return clips


def clips_by_intervals(
    labels: Path, root: Path, rest: str | None, site_pattern: str | None
) -> list[Clip]:
    """Return the clips that an interval file names; videos are looked for below `root`.

    Raises:
        FootageError: the file is wrong, or names a video that is not there; or `rest` is no class.
    """
    if rest is not None:
        check_name(rest)
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
    """Return the site that a clip's name tells by the first group of `pattern`.

    Raises:
        FootageError: the pattern is no regular expression, or finds nothing.
    """
    if pattern is None:
        return otherwise
    try:
        match = re.search(pattern, name)
    except re.error as error:
        raise FootageError(f"--site-from {pattern!r} is no regular expression: {error}") from error
    if match is None or match.lastindex is None:
        raise FootageError(
            f"--site-from {pattern!r} finds no group in {name!r}: try it on the names of all clips"
        )
    return match.group(1)
