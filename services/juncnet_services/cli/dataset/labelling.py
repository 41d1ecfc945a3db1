"""A labelling session: the clips, what is said about them, and their frames."""

import threading
from pathlib import Path
from typing import Any

from juncnet.learning.footage.labelling import Action, MarkAction, OpenAction
from juncnet_services.cli.dataset.frames import FrameStore
from juncnet_services.cli.dataset.journal import Journal
from juncnet_services.cli.dataset.videos import Video

FRAME_WIDTH = 960
OPEN_CLIPS = 3
"""Clips whose frames are kept at a time."""


class Labelling:
    """What the labelling page shows and changes. Safe to use from several threads."""

    def __init__(
        self, videos: dict[str, Video], classes: tuple[str, ...], out: Path, sites: dict[str, str]
    ) -> None:
        """Go on where the journal of `out` ends.

        Args:
            videos: By clip name, in the order in which they are shown.
            classes: In the order of the keys 1, 2, ...; marks found in the journal may add others.
            out: The interval file.
            sites: Where each clip was filmed, as far as known.

        Raises:
            FootageError: the journal cannot be used.
        """
        self._videos, self._lock = videos, threading.Lock()
        self._journal = Journal(out)
        self.resumed = self._journal.resumed
        known = set(self._journal.labels.clips)
        for name, video in videos.items():
            if name not in known:
                site = sites.get(name, "")
                self._journal.apply(OpenAction(clip=name, duration_s=video.duration_s, site=site))
        labels = self._journal.labels
        used = {mark.label for clip in labels.clips for mark in labels.marks(clip)} - {""}
        self.classes = (*classes, *sorted(used - set(classes)))
        self._stores: dict[str, FrameStore] = {}

    def act(self, action: Action) -> None:
        """Save the action and do it.

        Raises:
            KeyError: there is no such clip.
            ValueError: there is no such class.
            OSError: it cannot be saved.
        """
        if isinstance(action, MarkAction) and action.label not in ("", *self.classes):
            raise ValueError(f"there is no class {action.label!r}")
        if isinstance(action, OpenAction):
            raise ValueError("clips are named when the tool is started")
        with self._lock:
            self._journal.apply(action)

    def picture(self, clip: str, index: int) -> bytes:
        """Return a frame as JPEG.

        Raises:
            KeyError: there is no such clip.
            FootageError: there is no such frame, or it is damaged.
        """
        with self._lock:
            store = self._stores.pop(clip, None) or FrameStore(self._videos[clip], FRAME_WIDTH)
            self._stores[clip] = store
            while len(self._stores) > OPEN_CLIPS:
                del self._stores[next(iter(self._stores))]
        return store.picture(index)

    def state(self) -> dict[str, Any]:
        """Return all that the page shows, but for the frames."""
        with self._lock:
            labels = self._journal.labels
            return {
                "classes": self.classes,
                "out": str(self._journal.out),
                "undoable": labels.undoable,
                "clips": [
                    {
                        "name": name,
                        "site": labels.site(name),
                        "seen_s": labels.seen_s(name),
                        "duration_s": video.duration_s,
                        "frames": len(video.times_s),
                        "marks": [(m.at_s, m.label) for m in labels.marks(name)],
                    }
                    for name, video in self._videos.items()
                ],
            }

    def times_s(self, clip: str) -> list[float]:
        """Return the time of every frame of a clip.

        Raises:
            KeyError: there is no such clip.
        """
        return self._videos[clip].times_s

    def close(self) -> None:
        """Close the journal."""
        with self._lock:
            self._journal.close()
