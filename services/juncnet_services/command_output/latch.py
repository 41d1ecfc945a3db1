"""What a restart must not forget: the stop latch, and when a velocity was last accepted."""

import os
from pathlib import Path

from pydantic import ValidationError

from juncnet.clocks import NS_PER_S, Instant
from juncnet_services.command_output.arbiter import Latched, LatchKind

LATCH = "stop.json"
LAST_ACCEPTED = "last-accepted"
RECORD_EVERY_S = 0.5


class Latch:
    """The stop in a file of `directory`, on disk (fsync) before `keep` returns."""

    def __init__(self, directory: Path) -> None:
        self.path = directory / LATCH
        self._kept = self.read()

    def read(self) -> Latched | None:
        """Return the stop; None only if there is no file. An unreadable or malformed one stops."""
        try:
            return Latched.model_validate_json(self.path.read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValidationError) as error:
            why = f"{self.path} is unreadable: {type(error).__name__}"
            return Latched(kind=LatchKind.HOLD, reason=why)

    def keep(self, latched: Latched | None) -> str:
        """Make `latched` what a restart will find; return what went wrong, empty if nothing did."""
        if latched == self._kept:
            return ""
        try:
            if latched is None:
                self.path.unlink(missing_ok=True)
            else:
                _write(self.path, latched.model_dump_json().encode())
            _sync(self.path.parent)
        except OSError as error:
            return f"the stop latch could not be written, a restart forgets this: {error}"
        self._kept = latched
        return ""


class LastAccepted:
    """When a velocity was last accepted in this flight, within `RECORD_EVERY_S`.

    It outlives the process, not the host: it is written without fsync.
    """

    def __init__(self, directory: Path) -> None:
        self.path = directory / LAST_ACCEPTED
        self._kept: Instant | None = None

    def read(self) -> Instant | None:
        """Return the time; None before the first; a time on no clock when the file is malformed."""
        try:
            ns, clock = self.path.read_text().split()
            return Instant(int(ns), clock)
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            return Instant(0, "unknown")

    def keep(self, accepted: Instant | None) -> str:
        """Record the time, at most every `RECORD_EVERY_S`; return what went wrong, if anything."""
        if accepted is None or (
            self._kept is not None and accepted.ns - self._kept.ns < RECORD_EVERY_S * NS_PER_S
        ):
            return ""
        self._kept = accepted
        temporary = self.path.with_suffix(".new")
        try:
            temporary.write_text(f"{accepted.ns} {accepted.clock}")
            temporary.replace(self.path)
        except OSError as error:
            return f"the last command's time could not be written, a restart forgets it: {error}"
        return ""


def _write(path: Path, data: bytes) -> None:
    """Replace `path` by `data` in one step, the data on disk first."""
    temporary = path.with_suffix(".new")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def _sync(directory: Path) -> None:
    """Put the names in `directory` on disk."""
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
