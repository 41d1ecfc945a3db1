"""A folder of pictures as a camera, in the order of their names."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from juncnet.clocks import Clock
from juncnet.frames import FrameLayout
from juncnet.messages import MessageError, PixelFormat
from juncnet_services.frame_capture.contract import AccessUnit, CameraError, Counts, Picture
from juncnet_services.frame_capture.pacing import Pacer
from juncnet_services.frame_capture.planes import write_pixels
from juncnet_services.frame_capture.sources import FolderSource

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".pgm", ".tif", ".tiff", ".webp"})


class FolderCamera:
    """Shows the pictures of a folder one after another, as BGR8."""

    live = False

    def __init__(self, source: FolderSource, clock: Clock, sleep: Callable[[float], None]) -> None:
        """List the folder.

        Raises:
            CameraError: it is missing, or no picture is in it.
        """
        self.counts = Counts()
        self.ended = False
        self._source = source
        self._clock = clock
        self._pacer = Pacer(clock, sleep, source.pace)
        self._paths = _pictures_in(source.path)
        self._shown = 0
        self._unreadable = 0

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Picture | None]:
        """Give the next picture when it is due; None after `timeout_s` or at the end."""
        if self.ended or not self._pacer.wait(self._shown / self._source.fps, timeout_s):
            yield None
            return
        path = self._paths[self._shown % len(self._paths)]
        self._shown += 1
        picture = self._read(path)
        if picture is None:
            self._skip(path)
        last = self._shown % len(self._paths) == 0
        self.ended = last and (not self._source.loop or self._unreadable >= len(self._paths))
        self._unreadable = 0 if last else self._unreadable
        yield picture

    def access_units(self) -> list[AccessUnit]:
        """Return nothing: these are no H.264 pictures."""
        return []

    def want_key_frame(self) -> None:
        """Do nothing: these are no H.264 pictures."""

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def _read(self, path: Path) -> Picture | None:
        """Return the picture in a file; None: there is none, or of a size that no frame has."""
        try:
            # Not imread: with a name that is not UTF-8 OpenCV 5.0.0 ends the process.
            found = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_COLOR)
            if found is None:
                return None
            pixels = np.asarray(found, dtype=np.uint8)
            height, width = pixels.shape[:2]
            layout = FrameLayout.packed(PixelFormat.BGR8, width, height)
        except (cv2.error, MessageError, OSError):
            return None
        return Picture(layout, partial(write_pixels, pixels), self._clock.now_ns())

    def _skip(self, path: Path) -> None:
        self._unreadable += 1
        self.counts.corrupt += 1
        self.counts.problems.append(
            f"{path}: no readable picture, or not 2 to 16384 pixels wide and high; skipped: remove "
            "or replace it"
        )


def _pictures_in(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise CameraError(
            f"image folder {folder} does not exist (working directory {Path.cwd()}): "
            "correct frame_capture's source.path"
        )
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if not paths:
        raise CameraError(
            f"image folder {folder} has no picture: put files in it that end in "
            + ", ".join(sorted(SUFFIXES))
        )
    return paths
