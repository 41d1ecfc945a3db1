"""Reads recordings: whole ones, ones of several files, and ones whose recorder was killed."""

import struct
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError
from mcap import records
from mcap.exceptions import McapError
from mcap.stream_reader import StreamReader

from juncnet.messages import BulkMessage, JpegImage, MessageError, VideoPacket
from juncnet.recording import FLIGHT_METADATA, LAYOUT_ATTACHMENT, PAYLOAD, SUFFIX
from juncnet.topics import ROOT, TOPICS, Request, Topic, health_topic


class RecordingError(ValueError):
    """A recording cannot be used; the text says why and what to do."""


@dataclass(frozen=True)
class Recorded:
    """A message as it was recorded."""

    time_ns: int
    """Arrival, nanoseconds since 1970."""
    robot: str
    topic: Topic[Any]
    message: Any
    """Of the topic's message type."""


@dataclass(frozen=True)
class Recording:
    """A recording: its files in order, and what they say of their flight."""

    files: tuple[Path, ...]
    metadata: dict[str, str]
    layout: str | None
    """The layout as JSON (`juncnet.layout.load_layout`); None: its recorder did not know it."""

    @property
    def robot(self) -> str:
        """The robot that was recorded."""
        return self.metadata["robot"]

    @property
    def flight(self) -> str:
        """Id of the flight."""
        return self.metadata["flight"]

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[Recorded]:
        """Yield what was recorded, in order; `topics`: only of these keys (below the robot's).

        A file that ends in the middle of a record, because its recorder was killed, ends there.
        """
        wanted = None if topics is None else frozenset(topics)
        for path in self.files:
            yield from _messages(path, wanted)


def open_recording(path: Path) -> Recording:
    """Return the recording in a file, with its following parts, or the newest one in a folder.

    Raises:
        RecordingError: there is none, or it is not one of ours.
    """
    if path.is_dir():
        first = sorted(path.glob(f"*-000{SUFFIX}"), key=lambda p: p.stat().st_mtime)
        if not first:
            raise RecordingError(f"{path}: no recording (*-000{SUFFIX}) in this folder")
        path = first[-1]
    files = _parts(path)
    metadata: dict[str, str] | None = None
    layout: str | None = None
    for record in file_records(files[0]):
        if isinstance(record, records.Metadata) and record.name == FLIGHT_METADATA:
            metadata = dict(record.metadata)
        if isinstance(record, records.Attachment) and record.name == LAYOUT_ATTACHMENT:
            layout = record.data.decode()
        if isinstance(record, records.Message):
            break
    if metadata is None:
        raise RecordingError(f"{path}: an MCAP file, but not one of juncnet record")
    return Recording(files, metadata, layout)


def _parts(path: Path) -> tuple[Path, ...]:
    """Return `path` and the parts that follow it: NAME-000.mcap, NAME-001.mcap, ..."""
    stem, _, number = path.stem.rpartition("-")
    if not stem or not number.isdigit():
        return (path,)
    rest = sorted(path.parent.glob(f"{stem}-[0-9]*{SUFFIX}"))
    return (path, *(p for p in rest if p.stem > path.stem and p.stem.rpartition("-")[0] == stem))


def file_records(path: Path) -> Generator[records.McapRecord]:
    """Yield the records of a file as far as it goes.

    Raises:
        RecordingError: it cannot be read at all.
    """
    count = 0
    try:
        with path.open("rb") as stream:
            for record in StreamReader(stream, record_size_limit=2**30).records:
                count += 1
                yield record
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except (McapError, struct.error, EOFError, ValueError) as error:
        if count == 0:
            raise RecordingError(f"{path}: not an MCAP file ({error})") from error


def _messages(path: Path, wanted: frozenset[str] | None) -> Generator[Recorded]:
    channels: dict[int, records.Channel] = {}
    waiting: tuple[int, bytes, Topic[Any], str] | None = None
    for record in file_records(path):
        if isinstance(record, records.Channel):
            channels[record.id] = record
        if not isinstance(record, records.Message):
            continue
        channel = channels[record.channel_id]
        whole = channel.topic.removesuffix(PAYLOAD)
        robot, topic = _topic(whole)
        if topic is None or (wanted is not None and topic.key not in wanted):
            continue
        if whole != channel.topic and waiting is not None and waiting[0] == record.sequence:
            payload = _payload(topic, record.data)
            yield _decoded(record.log_time, robot, topic, payload, waiting[1])
        elif issubclass(topic.message, BulkMessage):
            waiting = (record.sequence, record.data, topic, robot)
        else:
            yield _decoded(record.log_time, robot, topic, record.data, None)


def _topic(key: str) -> tuple[str, Topic[Any] | None]:
    parts = key.split("/", 2)
    if len(parts) != 3 or parts[0] != ROOT:
        return "", None
    robot, below = parts[1], parts[2]
    if below.startswith("health/") and below.count("/") == 1:
        return robot, health_topic(below.split("/")[1])
    return robot, _TOPICS.get(below)


_TOPICS: dict[str, Topic[Any]] = {
    topic.key: topic
    for topic in TOPICS
    if isinstance(topic, Topic) and not isinstance(topic, Request)
}


def _payload(topic: Topic[Any], data: bytes) -> bytes:
    try:
        if topic.message is VideoPacket:
            return CompressedVideo.FromString(data).data
        if topic.message is JpegImage:
            return CompressedImage.FromString(data).data
    except DecodeError as error:
        raise RecordingError(f"{topic.key}: a damaged picture: {error}") from error
    return data


def _decoded(
    time_ns: int, robot: str, topic: Topic[Any], payload: bytes, attachment: bytes | None
) -> Recorded:
    try:
        return Recorded(time_ns, robot, topic, topic.message.decode(payload, attachment))
    except MessageError as error:
        raise RecordingError(f"{topic.key}: recorded by another version: {error}") from error
