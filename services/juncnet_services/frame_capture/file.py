"""A video file as a camera: at its own pace or as fast as possible, once or over and over."""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av
from av.container import InputContainer
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from juncnet.clocks import Clock
from juncnet.messages import MessageError
from juncnet_services.frame_capture.contract import AccessUnit, CameraError, Counts, Picture
from juncnet_services.frame_capture.decoding import Decoder
from juncnet_services.frame_capture.pacing import Pacer
from juncnet_services.frame_capture.planes import picture_of
from juncnet_services.frame_capture.sources import FileSource

USUAL_FPS = 25.0
"""For files that do not tell their rate."""


class FileCamera:
    """Plays a video file; the capture time of a picture is when it was due."""

    live = False

    def __init__(
        self, source: FileSource, clock: Clock, sleep: Callable[[float], None], *, decode: bool
    ) -> None:
        """Open the file.

        Raises:
            CameraError: it is missing, no video, or damaged from the start.
        """
        self.counts = Counts()
        self.ended = False
        self._source = source
        self._clock = clock
        self._decode = decode
        self._pacer = Pacer(clock, sleep, source.pace)
        self._units: list[AccessUnit] = []
        self._container, self._stream = _open(source.path)
        self._steps = self._play()
        self._waiting: tuple[float, VideoFrame | None] | None = None

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Picture | None]:
        """Give the next picture when it is due; None after `timeout_s` or at the end."""
        if self._waiting is None:
            self._waiting = next(self._steps, None)
        if self._waiting is None:
            self.ended = True
            yield None
            return
        time_s, frame = self._waiting
        if not self._pacer.wait(time_s, timeout_s):
            yield None
            return
        self._waiting = None
        yield None if frame is None else self._picture(frame)

    def access_units(self) -> list[AccessUnit]:
        """Remove and return the access units up to the newest picture."""
        units, self._units = self._units, []
        return units

    def want_key_frame(self) -> None:
        """Do nothing: a recording has those that it has."""

    def close(self) -> None:
        """Close the file."""
        self._steps.close()
        self._container.close()

    def _picture(self, frame: VideoFrame) -> Picture | None:
        try:
            return picture_of(frame, self._clock.now_ns())
        except MessageError as error:
            self.counts.corrupt += 1
            self.counts.problems.append(
                f"{self._source.path}: {error}; skipped: give a video of another size"
            )
            return None

    def _play(self) -> Generator[tuple[float, VideoFrame | None]]:
        """Yield (time in s since the start, frame); no frame where only access units are wanted."""
        step_s = 1.0 / float(self._stream.average_rate or USUAL_FPS)
        begin_s = 0.0
        while True:
            time_s = begin_s
            for time_s, frame in self._play_once(begin_s, step_s):
                yield time_s, frame
            if not self._source.loop or time_s == begin_s:
                return
            begin_s = time_s + step_s
            self._container.close()
            self._container, self._stream = _open(self._source.path)

    def _play_once(
        self, begin_s: float, step_s: float
    ) -> Iterator[tuple[float, VideoFrame | None]]:
        decoder = Decoder(self._stream, self.counts, low_delay=False, decode=self._decode)
        time_s, first_s = begin_s - step_s, None
        for packet in self._packets():
            for frame, _ in decoder.feed(packet, self._clock.now_ns()):
                if frame.pts is None:
                    time_s += step_s
                else:
                    first_s = frame.time if first_s is None else first_s
                    time_s = begin_s + frame.time - first_s
                yield time_s, frame
            self._units.extend(decoder.take_units())
            if not self._decode:
                time_s += step_s
                yield time_s, None

    def _packets(self) -> "Iterator[Packet[Any]]":
        """Yield the packets of the file, an empty one last, whatever damage ends it."""
        try:
            yield from self._container.demux(self._stream)
        except FFmpegError as error:
            self.counts.corrupt += 1
            self.counts.problems.append(f"{self._source.path}: damaged, read no further: {error}")
            yield Packet()


def _open(path: Path) -> tuple[InputContainer, VideoStream]:
    try:
        container = av.open(str(path))
    except FileNotFoundError as error:
        raise CameraError(
            f"video file {path} does not exist (working directory {Path.cwd()}): "
            "correct frame_capture's source.path"
        ) from error
    except (FFmpegError, OSError) as error:
        raise CameraError(
            f"video file {path} cannot be read ({error}): is it complete, and a video? "
            "Try it with `ffprobe`"
        ) from error
    if not container.streams.video:
        container.close()
        raise CameraError(f"{path} has no video stream: give a video file as source.path")
    return container, container.streams.video[0]
