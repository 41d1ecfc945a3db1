"""Which class a clip shows from when to when: the interval file, read and written.

The file is CSV with the columns `clip, from, to, class` and, where wanted, `site` and `split`.
Times are seconds (`12.5`) or `minutes:seconds` (`1:02.5`); an interval holds its beginning and not
its end. Empty lines and lines that begin with `#` say nothing: a clip whose name begins so stands
in quotation marks. Times are to the millisecond: a frame may be `ROUNDING_S` before its own.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from juncnet.learning import datasets
from juncnet.learning.datasets import Split

COLUMNS = ("clip", "from", "to", "class")
OPTIONAL = ("site", "split")
SPLITS: tuple[Split, ...] = ("train", "validation", "test")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
"""What a class may be called: it names folders, and travels in messages."""

ROUNDING_S = 0.00051
"""So far from its frame a time may be that is written to the millisecond."""


class FootageError(ValueError):
    """Footage, labels or a data set cannot be used; the text names the cause and the remedy."""


@dataclass(frozen=True)
class Interval:
    """A part of a clip that shows one class. Times are seconds since the clip's first frame."""

    clip: str
    """File name of the clip, or its path relative to the interval file."""
    start_s: float
    end_s: float
    label: str
    site: str = ""
    """Where it was filmed; empty: not said."""
    split: Split = ""
    """The side it is meant for; empty: drawn."""


def check_name(label: str) -> None:
    """Refuse what no class may be called.

    Raises:
        FootageError: `label` does not match `NAME`.
    """
    if not NAME.fullmatch(label):
        raise FootageError(f"class {label!r}: use letters, digits, '_', '-' and '.'")


def parse_time(text: str) -> float:
    """Return the seconds of `12.5`, `1:02.5` or `1:00:02.5`.

    Raises:
        ValueError: it is no such time, or negative.
    """
    seconds = 0.0
    for part in text.strip().split(":"):
        seconds = 60 * seconds + float(part)
        if not (math.isfinite(seconds) and float(part) >= 0):
            raise ValueError(f"{text!r} is no time")
    return seconds


def read_intervals(text: str, source: str) -> list[Interval]:
    """Return the intervals of an interval file, in its order.

    Args:
        text: The file's content.
        source: Its name, for errors.

    Raises:
        FootageError: a column is missing, a line is wrong, or two intervals of a clip that overlap
            name different classes; the text says where.
    """
    lines = [(n, line) for n, line in enumerate(text.lstrip("\ufeff").splitlines(), 1)]
    lines = [(n, line) for n, line in lines if line.strip() and not line.lstrip().startswith("#")]
    rows = [_fields(line, f"{source}, line {number}") for number, line in lines]
    header = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise FootageError(
            f"{source}: no column {', '.join(missing)}: the first line must be "
            f"`{','.join(COLUMNS)}` (and may name {', '.join(OPTIONAL)})"
        )
    found: list[Interval] = []
    for (number, _), row in zip(lines[1:], rows[1:], strict=True):
        values = {name: value.strip() for name, value in zip(header, row, strict=False)}
        try:
            found.append(_interval(values))
        except ValueError as error:
            raise FootageError(f"{source}, line {number}: {error}") from error
    _refuse_overlaps(found, source)
    return found


def _fields(line: str, where: str) -> list[str]:
    try:
        return next(csv.reader([line], skipinitialspace=True, strict=True))
    except csv.Error as error:
        raise FootageError(f"{where}: {error}: a quotation mark is not closed, or alone") from error


def _interval(values: dict[str, str]) -> Interval:
    missing = [name for name in COLUMNS if not values.get(name)]
    if missing:
        raise ValueError(f"nothing stands under {', '.join(missing)}")
    check_name(values["class"])
    try:
        start_s, end_s = parse_time(values["from"]), parse_time(values["to"])
    except ValueError as error:
        raise ValueError(
            f"from {values['from']!r} to {values['to']!r}: write seconds or minutes:seconds"
        ) from error
    if end_s <= start_s:
        raise ValueError(f"the interval ends at {end_s:g} s, not after its beginning {start_s:g} s")
    asked = values.get("split", "")
    known: dict[str, Split] = {str(s): s for s in datasets.SPLITS}
    if asked not in known:
        raise ValueError(f"split {asked!r}: use {', '.join(SPLITS)}, or leave it empty")
    site = values.get("site", "")
    return Interval(values["clip"], start_s, end_s, values["class"], site, known[asked])


def _refuse_overlaps(intervals: Sequence[Interval], source: str) -> None:
    longest: dict[str, Interval] = {}
    for interval in sorted(intervals, key=lambda i: (i.clip, i.start_s)):
        before = longest.get(interval.clip)
        if before and interval.start_s < before.end_s and interval.label != before.label:
            raise FootageError(
                f"{source}: {interval.clip} is {before.label} until {before.end_s:g} s and "
                f"{interval.label} from {interval.start_s:g} s: let one end where the other begins"
            )
        if before is None or interval.end_s > before.end_s:
            longest[interval.clip] = interval


def write_intervals(intervals: Iterable[Interval]) -> str:
    """Return the text of an interval file; times to the millisecond.

    Clips whose names begin with `#` stand in quotation marks, so that they are no comments.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    quoting = csv.writer(out, lineterminator="\n", quoting=csv.QUOTE_ALL)
    writer.writerow((*COLUMNS, *OPTIONAL))
    for i in intervals:
        times = (f"{i.start_s:.3f}", f"{i.end_s:.3f}")
        chosen = quoting if i.clip.startswith("#") else writer
        chosen.writerow((i.clip, *times, i.label, i.site, i.split))
    return out.getvalue()


def interval_at(intervals: Iterable[Interval], time_s: float) -> Interval | None:
    """Return the interval that holds a frame's time; None: nobody has said what it shows.

    A frame that is within rounding before a beginning is the one that was marked there.
    """
    at_s = time_s + ROUNDING_S
    return next((i for i in intervals if i.start_s <= at_s < i.end_s), None)


def classes_of(labels: Iterable[str]) -> tuple[str, ...]:
    """Return the classes in the order of a model's outputs: `none` first, the others by name."""
    return ("none", *sorted(set(labels) - {"none"}))
