"""Where the progress of a flight is kept, so that a restarted navigator goes on with it."""

import os
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ValidationError

from juncnet.messages import Mission
from juncnet_services.junction_navigation.progress import Progress

FILE_NAME = "navigation.json"


class _Owner(BaseModel):
    """The part of a saved progress that says whose it is."""

    flight: str


@dataclass(frozen=True)
class Resumed:
    """What a restart found."""

    progress: Progress | None
    """To go on with; None: start with a count of 0."""
    note: str
    """What was found, for the log."""
    blocked: str = ""
    """Why the robot must hold until a mission is set: the progress of this flight was lost."""


FRESH = Resumed(None, "the count starts at 0")
"""Nothing was saved."""


class Store:
    """Keeps the newest progress in one file of the flight's directory, replaced atomically.

    A process may be killed at any moment: the file is the old record or the new one. It is not
    synced to the disk: a host that loses power ends the flight.
    """

    def __init__(self, directory: Path) -> None:
        self._path = directory / FILE_NAME
        self._scratch = directory / f"{FILE_NAME}.new"

    def save(self, progress: Progress) -> None:
        """Replace the saved progress. Raises OSError when the directory cannot be written."""
        self._scratch.write_text(progress.model_dump_json())
        os.replace(self._scratch, self._path)

    def resume(self, flight: str, mission: Mission) -> Resumed:
        """Return the progress of this flight and of this configured mission.

        A file that cannot be read in a flight's own directory means that junctions were counted and
        nobody knows how many: no turn may be guessed from there, so the robot holds.
        """
        try:
            text = self._path.read_text()
        except FileNotFoundError:
            return FRESH
        except (OSError, UnicodeDecodeError) as error:
            return self._lost(str(error))
        try:
            if _Owner.model_validate_json(text).flight != flight:
                return Resumed(None, "the count starts at 0: what was saved is of another flight")
            progress = Progress.model_validate_json(text)
        except ValidationError as error:
            return self._lost(str(error.errors(include_url=False)[0]["msg"]))
        if progress.configured != mission:
            return Resumed(None, "the count starts at 0: what was saved is of another mission")
        return Resumed(progress, f"resumed at junction {progress.count}, {progress.phase}")

    def _lost(self, why: str) -> Resumed:
        reason = f"the count of this flight is lost ({self._path}: {why[:200]}): set a mission"
        return Resumed(None, "", blocked=reason)
