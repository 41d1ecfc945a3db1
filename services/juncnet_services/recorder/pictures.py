"""The camera's pictures as the recording needs them: its own H.264, or ours."""

import os
import sys
import threading
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor, wait

from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import NS_PER_S
from juncnet.frames import Frame, FrameReader
from juncnet.messages import VideoPacket
from juncnet.smaller import smaller
from juncnet_services.recorder.video import Encoder

SILENCE_S = 2.0
"""A camera that has given no H.264 of its own for so long gives none."""
WAITING = 8
"""Frames that wait for the encoder, 6 MB: a third of a second without any time for it."""


class VideoOptions(BaseModel):
    """Of the video that is encoded here, where the camera gives none of its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    max_width: int = Field(
        default=960,
        ge=2,
        le=16384,
        description="Wider pictures are made smaller [px]; a camera's own video is kept.",
    )
    crf: int = Field(default=24, ge=0, le=51, description="Of our own video: 0 is lossless.")
    key_frame_every: int = Field(default=25, ge=1, description="Frames from key frame to key frame")


class Pictures:
    """Encodes every frame, unless the camera's own video is heard; `reader` None: never.

    A thread of the lowest class encodes: it takes the time that the flight and all others leave.
    Some frames wait for it; when there are more, those that come are left out.
    """

    def __init__(self, reader: FrameReader | None, options: VideoOptions) -> None:
        self._reader, self._max_width = reader, options.max_width
        self._encoder = Encoder(options.crf, options.key_frame_every)
        self._worker = ThreadPoolExecutor(1, "encoder", initializer=_take_what_is_left)
        self._encoding: deque[Future[VideoPacket]] = deque()
        self._own_until_ns = 0
        self._anew = False

    @property
    def busy(self) -> bool:
        """Whether frames are being encoded."""
        return bool(self._encoding)

    def camera_gave(self, now_ns: int) -> None:
        """Note that the camera's own video was heard: ours is needless for a while."""
        self._own_until_ns = now_ns + int(SILENCE_S * NS_PER_S)

    def next(self, now_ns: int, timeout_s: float) -> list[VideoPacket]:
        """Take the next frame and return those that are encoded by now, in order."""
        if self._reader is None:
            return []
        taken = len(self._encoding) < WAITING and self._take(self._reader, now_ns, timeout_s)
        if not taken and self._encoding:
            wait((self._encoding[0],), timeout_s)
        ready: list[VideoPacket] = []
        while self._encoding and self._encoding[0].done():
            ready.append(self._encoding.popleft().result())
        return ready

    def restart(self) -> None:
        """Let the next frame be one that decoding can start with: a new file has begun."""
        self._anew = True

    def _take(self, reader: FrameReader, now_ns: int, timeout_s: float) -> bool:
        with reader.take(timeout_s) as frame:
            if frame is None or now_ns < self._own_until_ns:
                return False
            small = smaller(frame, self._max_width)
            kept = Frame(small.header, small.layout, small.pixels.copy())
        self._encoding.append(self._worker.submit(self._encode, kept))
        return True

    def _encode(self, frame: Frame) -> VideoPacket:
        if self._anew:
            self._anew = False
            self._encoder.restart()
        return self._encoder.encode(frame)


def _take_what_is_left() -> None:
    """Give way to every other thread of this machine, where threads have a class of their own."""
    if sys.platform == "linux":
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_IDLE, os.sched_param(0))
