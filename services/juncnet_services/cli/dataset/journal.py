"""What was labelled, on disk at every key: a journal of actions, and the interval file."""

import os
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from juncnet.learning.footage.intervals import FootageError, write_intervals
from juncnet.learning.footage.labelling import Action, Labels
from juncnet.learning.footage.writer import write_atomically

_ACTION: TypeAdapter[Action] = TypeAdapter(Action)


class Journal:
    """Labels that survive whatever ends the process.

    Every action is appended to `OUT.journal` and synced before the answer; the interval file
    `OUT` is then replaced in one step. A line cut off by a crash is dropped.
    """

    def __init__(self, out: Path) -> None:
        """Go on with what `OUT.journal` holds.

        Raises:
            FootageError: the journal is damaged elsewhere than in its last line, or there is an
                interval file that no journal has made.
        """
        self.out, self.path = out, out.with_name(out.name + ".journal")
        if out.exists() and not self.path.exists():
            raise FootageError(
                f"{out} was not written by this tool: move it away, or name another file with --out"
            )
        self.labels = Labels()
        lines = self.path.read_bytes().split(b"\n") if self.path.exists() else []
        whole = b"".join(line + b"\n" for line in lines[:-1])
        for number, line in enumerate(lines[:-1], 1):
            try:
                self.labels.apply(_ACTION.validate_json(line))
            except (ValidationError, KeyError) as error:
                raise FootageError(
                    f"{self.path}, line {number} is damaged: remove that line, or the file to "
                    "start anew"
                ) from error
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.resumed = bool(whole)
        self._file = self.path.open("ab")
        if self._file.tell() > len(whole):
            self._file.truncate(len(whole))

    def apply(self, action: Action) -> str:
        """Save the action, do it, and return the clip that it changed; empty: none.

        Raises:
            KeyError: it is about a clip that is not there; nothing is saved.
        """
        clip = self.labels.apply(action)
        self._file.write(action.model_dump_json().encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        write_atomically(self.out, write_intervals(self.labels.all_intervals()))
        return clip

    def close(self) -> None:
        """Close the file."""
        self._file.close()
