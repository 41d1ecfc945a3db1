"""Writes messages into one MCAP file, so that whoever kills the process loses the last second."""

import contextlib
import fcntl
import json
import time
from pathlib import Path
from typing import Any

from google.protobuf.message import Message as Protobuf
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from juncnet.clocks import Clock
from juncnet.messages import BulkMessage, Message
from juncnet.recording import PAYLOAD
from juncnet.recording.viewers import drawn, payload_of

CHUNK_BYTES = 16 * 1024
"""What can be lost in memory: a robot's own 25 states a second fill this in less than a second."""
FLUSH_NS = 500_000_000


class WallClock:
    """The wall clock at times of the monotonic clock: without the jumps of the wall clock."""

    def __init__(self, clock: Clock) -> None:
        self.id = clock.id
        self.offset_ns = time.time_ns() - clock.now_ns()
        self._clock = clock

    def now_ns(self) -> int:
        """Nanoseconds since 1970."""
        return self._clock.now_ns() + self.offset_ns


class RecordingWriter:
    """One MCAP file that grows; `close` completes it. Nothing in it is written twice or changed.

    It is locked (flock) until then: who repairs what killed recorders left keeps off it.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            FileExistsError: it is there already: recordings are never overwritten.
        """
        self.path = path
        self._stream = path.open("xb")
        with contextlib.suppress(OSError):  # no locks on this file system: no repairs either
            fcntl.flock(self._stream, fcntl.LOCK_EX)
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES)
        self._writer.start("juncnet")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequence = 0
        self._flushed_ns = 0

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._stream.tell()

    def metadata(self, name: str, fields: dict[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, fields)

    def attach(self, name: str, data: bytes, media_type: str, time_ns: int) -> None:
        """Write an attachment."""
        self._writer.add_attachment(time_ns, time_ns, name, media_type, data)

    def message(self, key: str, message: Message, time_ns: int, capture_ns: int) -> None:
        """Write a message that came at `time_ns`, of a picture captured at `capture_ns` (1970)."""
        self._sequence += 1
        payload, attachment = message.encode()
        fields = payload if attachment is None else attachment
        self._add(self._json_channel(key, message), fields, time_ns)
        if isinstance(message, BulkMessage):
            picture = payload_of(message, capture_ns)
            if picture is None:
                self._add(self._raw_channel(key + PAYLOAD, message), payload, time_ns)
            else:
                self._add_protobuf(key + PAYLOAD, picture, time_ns)
        for name, content in drawn(message, time_ns):
            self._add_protobuf(f"{key}/{name}", content, time_ns)
        if time_ns - self._flushed_ns > FLUSH_NS:
            self._flushed_ns = time_ns
            self._stream.flush()

    def close(self) -> None:
        """Write what makes the file complete: its index and summary."""
        self._writer.finish()
        self._stream.close()

    def _add(self, channel: int, data: bytes, time_ns: int) -> None:
        self._writer.add_message(channel, time_ns, data, time_ns, self._sequence)

    def _add_protobuf(self, topic: str, content: Protobuf, time_ns: int) -> None:
        if topic not in self._channels:
            name: str = content.DESCRIPTOR.full_name
            descriptors = build_file_descriptor_set(type(content)).SerializeToString()
            schema = self._schema(name, "protobuf", descriptors)
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema)
        self._add(self._channels[topic], content.SerializeToString(), time_ns)

    def _json_channel(self, key: str, message: Message) -> int:
        if key not in self._channels:
            schema: dict[str, Any] = type(message).model_json_schema()
            data = json.dumps(schema).encode()
            number = self._schema(message.schema_name(), "jsonschema", data)
            self._channels[key] = self._writer.register_channel(key, "json", number)
        return self._channels[key]

    def _raw_channel(self, topic: str, message: BulkMessage) -> int:
        if topic not in self._channels:
            encoding = message.media_type
            self._channels[topic] = self._writer.register_channel(topic, encoding, 0)
        return self._channels[topic]

    def _schema(self, name: str, encoding: str, data: bytes) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, encoding, data)
        return self._schemas[name]
