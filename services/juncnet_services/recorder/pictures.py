"""The camera's pictures as the recording needs them: its own H.264, or ours."""

from typing import Protocol

from juncnet.clocks import NS_PER_S
from juncnet.frames import FrameReader
from juncnet.messages import VideoPacket
from juncnet_services.recorder.video import Encoder

SILENCE_S = 2.0
"""A camera that has given no H.264 of its own for so long gives none."""


class Options(Protocol):
    """Quality of the video: options of the recorder."""

    @property
    def crf(self) -> int: ...
    @property
    def key_frame_every(self) -> int: ...


class Pictures:
    """Encodes the newest frame, unless the camera's own video is heard; `reader` None: never."""

    def __init__(self, reader: FrameReader | None, options: Options) -> None:
        self._reader = reader
        self._encoder = Encoder(options.crf, options.key_frame_every)
        self._own_until_ns = 0

    def camera_gave(self, now_ns: int) -> None:
        """Note that the camera's own video was heard: ours is needless for a while."""
        self._own_until_ns = now_ns + int(SILENCE_S * NS_PER_S)

    def next(self, now_ns: int, timeout_s: float) -> VideoPacket | None:
        """Return the next frame as an access unit; None when none came or none is needed."""
        if self._reader is None:
            return None
        with self._reader.take(timeout_s) as frame:
            if frame is None or now_ns < self._own_until_ns:
                return None
            return self._encoder.encode(frame)

    def restart(self) -> None:
        """Let the next access unit be one that decoding can start with: a new file has begun."""
        self._encoder.restart()
