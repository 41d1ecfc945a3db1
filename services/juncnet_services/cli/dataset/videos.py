"""Videos as footage: where they are, when each of their frames is, and the frames themselves."""

import shutil
import weakref
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from juncnet.frames import Frame
from juncnet.learning.footage.intervals import FootageError
from juncnet.messages import Stamp
from juncnet_services.cli.dataset.recordings import is_first_part, write_stream
from juncnet_services.frame_capture.contract import Counts
from juncnet_services.frame_capture.decoding import Decoder
from juncnet_services.frame_capture.planes import picture_of

RECORDING = ".mcap"
CONTAINERS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".ts", ".mts", ".webm", ".h264", ".264")
SUFFIXES = (RECORDING, *CONTAINERS)
USUAL_FPS = 25.0
"""For files that do not tell the times of their frames."""


class Video:
    """A video file or a recording: the times of its frames, and its frames from any of them on."""

    def __init__(self, path: Path) -> None:
        """Read the times of all frames; nothing is decoded.

        Raises:
            FootageError: there is no video at `path`, or it is damaged from the start.
        """
        self.path, self._file = path, path
        self.counts = Counts()
        """What was damaged in what was decoded so far."""
        taken_s: Sequence[float] = ()
        if path.suffix.lower() == RECORDING:
            folder = mkdtemp(prefix="juncnet-")
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
            self._file = Path(folder) / "video.h264"
            taken_s = write_stream(path, self._file)
        with _open(self._file) as container:
            stream = container.streams.video[0]
            self.width, self.height = stream.width, stream.height
            stamps = [packet.pts for packet in _packets(container, stream) if packet.size]
            base = float(stream.time_base or 0)
            step_s = 1.0 / float(stream.average_rate or USUAL_FPS)
        known = sorted({stamp for stamp in stamps if stamp is not None})
        self._index: dict[int, int] = {}
        if base > 0 and len(known) == len(stamps):
            self._index = {stamp: index for index, stamp in enumerate(known)}
            self.times_s = [(stamp - known[0]) * base for stamp in known]
        else:
            self.times_s = [index * step_s for index in range(len(stamps))]
        if len(taken_s) == len(self.times_s):
            self.times_s = list(taken_s)
        if not self.times_s:
            raise FootageError(f"{path} has no pictures: is it complete? Try it with `ffprobe`")
        self.duration_s = self.times_s[-1] + step_s

    def frames(self, first: int = 0) -> Iterator[tuple[int, VideoFrame]]:
        """Yield (index, frame) from index `first` on, in order.

        What is damaged is left out, up to the next key frame, as in flight.
        """
        with _open(self._file) as container:
            stream = container.streams.video[0]
            if self._index and first > 0:
                stamp = next(s for s, index in self._index.items() if index == first)
                container.seek(stamp, stream=stream)
            decoder, counted = Decoder(stream, self.counts, low_delay=False), _Counted()
            for packet in _packets(container, stream):
                if not self._index:
                    counted.number(packet)
                for frame, _ in decoder.feed(packet, 0):
                    index = (
                        self._index.get(frame.pts or 0, -1) if self._index else counted.at(frame)
                    )
                    if index >= first:
                        yield index, frame


class _Counted:
    """The indices of the pictures of a stream that has no times, some of which are left out.

    Packets come in the order of decoding, pictures in that of showing: between two key frames both
    are the same pictures, so these are counted from the key frame on.
    """

    def __init__(self) -> None:
        self._packets = 0
        self._keys: list[int] = []
        self._key, self._since = -1, 0

    def number(self, packet: "Packet[Any]") -> None:
        """Let a packet carry its number, whether it will be decoded or not."""
        if packet.size:
            packet.pts = self._packets
            if packet.is_keyframe:
                self._keys.append(self._packets)
            self._packets += 1

    def at(self, frame: VideoFrame) -> int:
        """Return the index of a decoded picture; each is asked for once, in order."""
        key = self._keys[bisect_right(self._keys, frame.pts or 0) - 1]
        self._since = self._since + 1 if key == self._key else 0
        self._key = key
        return key + self._since


def whole_frame(decoded: VideoFrame) -> Frame:
    """Return a decoded frame as frame_capture would send it."""
    picture = picture_of(decoded, 0)
    pixels = np.empty(picture.layout.nbytes, np.uint8)
    picture.write(pixels)
    return Frame(Stamp(epoch=0, sequence=0, time_ns=0, clock="file"), picture.layout, pixels)


def shown(decoded: VideoFrame, width: int) -> NDArray[np.uint8]:
    """Return a decoded frame for people, (H, W, 3) uint8 BGR, at most `width` wide."""
    scale = min(1.0, width / decoded.width)
    size = max(round(decoded.width * scale), 2), max(round(decoded.height * scale), 2)
    small = decoded.reformat(width=size[0], height=size[1], format="bgr24")
    return np.asarray(small.to_ndarray(), np.uint8)


def videos_in(folder: Path) -> list[Path]:
    """Return the videos in a folder and below it, by name.

    Raises:
        FootageError: there are none.
    """
    if not folder.is_dir():
        raise FootageError(f"{folder} is no folder: name one with videos in it")
    found = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    found = [p for p in found if p.suffix.lower() != RECORDING or is_first_part(p)]
    if not found:
        raise FootageError(f"{folder} has no videos: their names end in {', '.join(SUFFIXES)}")
    return found


def clip_names(paths: Sequence[Path], root: Path) -> dict[str, Path]:
    """Return the paths by clip name: the path below `root`, with `/`, or the file's name."""
    names: dict[str, Path] = {}
    for path in paths:
        below = path.resolve().is_relative_to(root.resolve())
        name = path.resolve().relative_to(root.resolve()).as_posix() if below else path.name
        if name in names and names[name].resolve() != path.resolve():
            raise FootageError(f"two videos are called {name}: rename one of them")
        names[name] = path
    return names


def _open(path: Path) -> InputContainer:
    try:
        container = av.open(str(path))
    except (FFmpegError, OSError) as error:
        reason = "it does not exist" if not path.exists() else str(error)
        raise FootageError(f"{path} cannot be read as a video: {reason}") from error
    if not container.streams.video:
        container.close()
        raise FootageError(f"{path} has no video stream: give a video file")
    return container


def _packets(container: InputContainer, stream: VideoStream) -> "Iterator[Packet[Any]]":
    """Yield the packets of a file, an empty one last, whatever damage ends it."""
    try:
        yield from container.demux(stream)
    except FFmpegError:
        yield Packet()
