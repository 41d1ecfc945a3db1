"""The camera's pictures as the recording needs them: its own H.264, or ours."""

import os
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from juncnet.clocks import NS_PER_S
from juncnet.frames import Frame, FrameReader
from juncnet.messages import VideoPacket
from juncnet.smaller import smaller
from juncnet_services.recorder.video import Encoder

SILENCE_S = 2.0
"""A camera that has given no H.264 of its own for so long gives none."""


class Options(Protocol):
    """Quality of the video: options of the recorder."""

    @property
    def max_width(self) -> int: ...
    @property
    def crf(self) -> int: ...
    @property
    def key_frame_every(self) -> int: ...


class Pictures:
    """Encodes the newest frame, unless the camera's own video is heard; `reader` None: never.

    A thread of the lowest class encodes: it takes the time that the flight and all others leave.
    """

    def __init__(self, reader: FrameReader | None, options: Options) -> None:
        self._reader, self._max_width = reader, options.max_width
        self._encoder = Encoder(options.crf, options.key_frame_every)
        self._worker = ThreadPoolExecutor(1, "encoder", initializer=_take_what_is_left)
        self._encoding: Future[VideoPacket] | None = None
        self._own_until_ns = 0
        self._anew = False

    @property
    def busy(self) -> bool:
        """Whether a frame is being encoded."""
        return self._encoding is not None

    def camera_gave(self, now_ns: int) -> None:
        """Note that the camera's own video was heard: ours is needless for a while."""
        self._own_until_ns = now_ns + int(SILENCE_S * NS_PER_S)

    def next(self, now_ns: int, timeout_s: float) -> VideoPacket | None:
        """Return the next frame as an access unit; None when none came, is needed or is ready."""
        if self._reader is None:
            return None
        if self._encoding is None:
            with self._reader.take(timeout_s) as frame:
                if frame is None or now_ns < self._own_until_ns:
                    return None
                small = smaller(frame, self._max_width)
                kept = Frame(small.header, small.layout, small.pixels.copy())
            if self._anew:  # here, for nobody encodes now
                self._encoder.restart()
                self._anew = False
            self._encoding = self._worker.submit(self._encoder.encode, kept)
        try:
            packet = self._encoding.result(timeout_s)
        except TimeoutError:
            return None
        self._encoding = None
        return packet

    def restart(self) -> None:
        """Let the next access unit be one that decoding can start with: a new file has begun."""
        self._anew = True


def _take_what_is_left() -> None:
    """Give way to every other thread of this machine, where threads have a class of their own."""
    if sys.platform == "linux":
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_IDLE, os.sched_param(0))
