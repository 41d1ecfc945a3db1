"""Frames of videos as JPEG, any of them at once: what the labelling page shows."""

import threading
from collections import OrderedDict
from collections.abc import Iterator

from av.video.frame import VideoFrame

from juncnet.learning.footage.intervals import FootageError
from juncnet.learning.footage.pixels import jpeg
from juncnet_services.cli.dataset.videos import Video, shown

CACHE_BYTES = 256 << 20
AHEAD = 60
"""Frames that a decoder may skip before it is cheaper to begin at another key frame."""


class FrameStore:
    """Frames of one video by index. Safe to use from several threads.

    The decoder stays where it was, so that the next frame in order costs one decoded frame; what
    was decoded on the way is kept, up to `cache_bytes`, the oldest going first.
    """

    def __init__(self, video: Video, width: int, cache_bytes: int = CACHE_BYTES) -> None:
        """`width`: wider frames are made smaller."""
        self.video = video
        self._width, self._limit = width, cache_bytes
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._decoder: Iterator[tuple[int, VideoFrame]] | None = None
        self._next = 0

    def picture(self, index: int) -> bytes:
        """Return frame `index` as JPEG; where it is damaged, the next one that is not.

        Raises:
            FootageError: there is no such frame, nor one behind it.
        """
        with self._lock:
            known = self._kept.get(index)
            if known is not None:
                self._kept.move_to_end(index)
                return known
            return self._decode(index)

    def _decode(self, index: int) -> bytes:
        if not 0 <= index < len(self.video.times_s):
            raise FootageError(f"{self.video.path} has no frame {index}")
        if self._decoder is None or not self._next <= index <= self._next + AHEAD:
            self._decoder = self.video.frames(index)
        for found, frame in self._decoder:
            self._next = found + 1
            if found >= index:
                data = jpeg(shown(frame, self._width), quality=80)
                self._keep(index, data)
                return data
        self._decoder = None
        raise FootageError(f"{self.video.path}: frame {index} cannot be decoded")

    def _keep(self, index: int, data: bytes) -> None:
        self._kept[index] = data
        self._bytes += len(data)
        while self._bytes > self._limit and len(self._kept) > 1:
            _, old = self._kept.popitem(last=False)
            self._bytes -= len(old)
