"""JPEG pictures for viewers and foreign followers, encoded beside the flight path, never in it."""

import sys
import threading
from collections.abc import Callable
from queue import Empty, Full, Queue

from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import NS_PER_S
from juncnet.frames import Frame
from juncnet.messages import JpegImage
from juncnet.priority import give_way
from juncnet.smaller import smaller

ENCODER_TICK_S = 0.2
HEAD_START_S = 0.015
"""By which the flight is ahead with a picture before it is encoded: both cores are its own."""
NICENESS = 10
"""Added to the encoder's own: on a busy machine viewers get fewer pictures, the flight does not."""


class JpegOptions(BaseModel):
    """How camera/image is made."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    quality: int = Field(default=80, ge=1, le=100, description="JPEG quality.")
    max_width: int = Field(
        default=960, ge=2, le=16384, description="Wider pictures are made smaller [px]."
    )
    rate_hz: float = Field(
        default=12.5,
        gt=0,
        le=1000,
        description="At most so many a second: enough to look at; a follower may want them all.",
    )


def encode_jpeg(frame: Frame, options: JpegOptions) -> JpegImage:
    """Return the picture as JPEG, at most `options.max_width` wide, under the frame's header."""
    import cv2

    pixels = smaller(frame, options.max_width).bgr()
    _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, options.quality])
    height, width = pixels.shape[:2]
    return JpegImage.of(data.tobytes(), header=frame.header, width=width, height=height)


class JpegEncoder:
    """Encodes frames in a thread of its own and hands them to `publish`."""

    def __init__(self, options: JpegOptions, publish: Callable[[JpegImage], None]) -> None:
        self._options = options
        self._publish = publish
        self._next_ns = 0
        self._waiting: Queue[Frame] = Queue(maxsize=1)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="jpeg", daemon=True)
        self._thread.start()

    def wants(self, now_ns: int) -> bool:
        """Return whether a frame offered now would be encoded: neither too soon nor busy."""
        return now_ns >= self._next_ns and self._waiting.empty()

    def offer(self, frame: Frame, now_ns: int) -> None:
        """Encode `frame`, whose pixels nobody will change; dropped when one waits already."""
        self._next_ns = now_ns + round(NS_PER_S / self._options.rate_hz * 0.9)
        try:
            self._waiting.put_nowait(frame)
        except Full:
            return

    def close(self) -> None:
        """Encode what waits, then end the thread."""
        self._closing.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        if sys.platform == "linux":  # where a thread has a niceness of its own
            give_way(NICENESS)
        while True:
            try:
                frame = self._waiting.get(timeout=ENCODER_TICK_S)
            except Empty:
                if self._closing.is_set():
                    return
                continue
            self._closing.wait(HEAD_START_S)
            self._publish(encode_jpeg(frame, self._options))
