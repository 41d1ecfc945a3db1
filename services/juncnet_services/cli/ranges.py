"""What options may be: numbers within a range, and places where a result can be written."""

import argparse
import math
import sys
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from pydantic import ValidationError


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return argparse's type of whole numbers from `least` to `most`."""
    span = f"at least {least}" if most is None else f"{least} to {most}"

    def number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least or (most is not None and value > most):
            raise argparse.ArgumentTypeError(f"{text}: give a whole number, {span}")
        return value

    return number


port = whole(0, 65535)
"""Argparse's type of a TCP port; 0 means any free one."""


def positive(text: str) -> float:
    """Argparse's type of finite numbers above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a number above 0")
    return value


def ending(suffix: str) -> Callable[[str], Path]:
    """Return argparse's type of files that end in `suffix`: those written beside end otherwise."""

    def path(text: str) -> Path:
        if Path(text).suffix != suffix:
            raise argparse.ArgumentTypeError(f"{text}: give a file that ends in {suffix}")
        return Path(text)

    return path


def why(error: Exception) -> str:
    """Return what is wrong: of a model's refusal the first field and what it must be."""
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors(include_url=False)[0]
    where, text = ".".join(str(part) for part in first["loc"]), first["msg"]
    text = text.removeprefix("Value error, ")
    return f"{where}: {text}, not {first['input']!r:.60}" if where else text


def make_room_for(out: Path) -> None:
    """Make the folder of a result before the work whose result it is.

    Raises:
        ValueError: the result could not be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out.parent):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(f"{out} cannot be written ({reason}): name another --out") from error
    if out.is_dir():
        raise ValueError(f"{out} is a folder: name a file with --out")


def keep_earlier(out: Path) -> None:
    """Put a result of long work, which is about to be done anew, beside `out` and say so."""
    if out.exists():
        written = datetime.fromtimestamp(out.stat().st_mtime, UTC)
        kept = out.with_stem(f"{out.stem}-{written:%Y%m%dT%H%M%SZ}")
        out.rename(kept)
        print(f"the earlier {out} is {kept.name} now; --resume goes on with one", file=sys.stderr)
