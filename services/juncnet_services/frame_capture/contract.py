"""What a camera is to frame_capture: pictures that write themselves, and what went wrong."""

from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from juncnet.frames import FrameLayout
from juncnet.messages import Stamp

UNITS_KEPT = 128
"""Access units that wait to be forwarded; about five seconds at 25 a second."""
PROBLEMS_KEPT = 16


class CameraError(Exception):
    """A camera cannot give pictures; the text names the cause and the remedy."""


@dataclass(frozen=True)
class Picture:
    """One picture of a camera, not yet copied anywhere.

    `write` fills a flat uint8 array of `layout.nbytes`, any number of times, until the next `take`
    of its camera. `captured_ns` is monotonic: when the packet arrived for streams, when it was due
    for recordings. `header` is set by cameras that stamp their pictures themselves.
    """

    layout: FrameLayout
    write: Callable[[NDArray[np.uint8]], None]
    captured_ns: int
    header: Stamp | None = None


@dataclass(frozen=True)
class AccessUnit:
    """One H.264 access unit in Annex B form, with parameter sets when it is a key frame."""

    payload: bytes
    key_frame: bool
    captured_ns: int
    lost_before: int
    header: Stamp | None = None
    """Set where the camera is another host's, which has stamped it."""


@dataclass
class Counts:
    """What a camera has met since its start; written by the thread that reads the camera."""

    lost: int = 0
    """Pictures missing from the sequence: gaps in H.264 frame numbers or in time stamps."""
    corrupt: int = 0
    """Packets or pictures that were damaged; never shown."""
    skipped: int = 0
    """Sound packets that could not be decoded for want of a key frame before them."""
    late: int = 0
    """Pictures replaced by a newer one before they were taken."""
    reconnects: int = 0
    """Times that a live camera came back."""
    problems: deque[str] = field(default_factory=lambda: deque(maxlen=PROBLEMS_KEPT))
    """Failures not yet reported, oldest first; cause and remedy each."""


class Camera(Protocol):
    """A source of pictures, live or recorded."""

    @property
    def live(self) -> bool:
        """Whether it sees the world now, so that an exact repeat means that it is frozen."""
        ...

    @property
    def ended(self) -> bool:
        """Whether no picture will ever come again (the end of a recording)."""
        ...

    @property
    def counts(self) -> Counts:
        """What it has met since its start."""
        ...

    def take(self, timeout_s: float) -> AbstractContextManager[Picture | None]:
        """Return a context that gives the next picture (the newest, if live).

        None after at most `timeout_s`, or sooner when only access units have arrived. The picture
        is valid within the context only.

        Raises:
            CameraError: no retry can help.
        """
        ...

    def access_units(self) -> list[AccessUnit]:
        """Remove and return the access units that arrived, oldest first; none if not H.264."""
        ...

    def want_key_frame(self) -> None:
        """Ask the camera for a key frame, if it can be asked: somebody cannot decode without."""
        ...

    def close(self) -> None:
        """Let go of the device, file or socket."""
        ...
