"""Where messages go: into files of bounded size, as long as the disk has room."""

import contextlib
import logging
import platform
import shutil
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from juncnet.bus import Bus
from juncnet.clocks import Clock
from juncnet.layout import SAVED
from juncnet.messages import Message, Stamp
from juncnet.recording import FLIGHT_METADATA, LAYOUT_ATTACHMENT, SUFFIX
from juncnet.recording.repair import claimed, repair_all
from juncnet.recording.writer import RecordingWriter, WallClock
from juncnet.topics import Qos, Topic

log = logging.getLogger(__name__)
LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "av", "eclipse-zenoh", "pydantic")
"""Whose versions a recording keeps: what the same pictures could be decided differently by."""


@dataclass(frozen=True)
class Limits:
    """When a file is full, and when the disk is."""

    split_bytes: int
    warn_free_bytes: int
    stop_free_bytes: int


@dataclass(frozen=True)
class Identity:
    """What a recording says of its flight."""

    flight: str
    robot: str
    version: str
    libraries: str
    """Python and libraries with their versions, as one line."""
    layout: str | None


Room = Literal["enough", "low", "full"]


@dataclass
class Session:
    """The recording of one flight: NAME-000.mcap, NAME-001.mcap, ...; each opens by itself.

    NAME is the flight, with .2 behind it where another recorder writes that flight, and so on.
    """

    folder: Path
    identity: Identity
    limits: Limits
    clock: Clock
    wall: WallClock
    recorder: int = 1
    parts: int = 0
    messages: int = 0
    _writer: RecordingWriter | None = None
    _kept: dict[str, Message] = field(default_factory=dict[str, Message])
    """The newest of every kept topic: repeated at the beginning of each file."""

    @property
    def path(self) -> Path:
        """The newest file."""
        number = "" if self.recorder == 1 else f".{self.recorder}"
        return self.folder / f"{self.identity.flight}{number}-{max(0, self.parts - 1):03d}{SUFFIX}"

    @property
    def size(self) -> int:
        """Bytes of the newest file."""
        return 0 if self._writer is None else self._writer.size

    def write(self, robot: str, topic: Topic[Any], message: Message) -> bool:
        """Write a message that has just come; return whether a new file began with it."""
        now_ns = self.wall.now_ns()
        key = topic.expression(robot)
        writer = self._writer
        fresh = writer is None or writer.size > self.limits.split_bytes
        if writer is None or fresh:
            writer = self._next(now_ns)
        writer.message(key, message, now_ns, self._capture_ns(message, now_ns))
        self.messages += 1
        if topic.qos is Qos.KEPT:
            self._kept[key] = message
        return fresh

    def room(self) -> Room:
        """Return how the disk stands."""
        free = shutil.disk_usage(self.folder).free
        if free < self.limits.stop_free_bytes:
            return "full"
        return "low" if free < self.limits.warn_free_bytes else "enough"

    def close(self) -> None:
        """Complete the newest file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _next(self, now_ns: int) -> RecordingWriter:
        self.close()
        writer = self._create()
        about = self.identity
        fields = {
            "flight": about.flight,
            "robot": about.robot,
            "version": about.version,
            "libraries": about.libraries,
            "clock": self.wall.id,
            "wall_minus_clock_ns": str(self.wall.offset_ns),
            "part": str(self.parts - 1),
        }
        writer.metadata(FLIGHT_METADATA, fields)
        if about.layout is not None:
            data = about.layout.encode()
            writer.attach(LAYOUT_ATTACHMENT, data, "application/json", now_ns)
        for key, message in self._kept.items():
            writer.message(key, message, now_ns, self._capture_ns(message, now_ns))
        self._writer = writer
        return writer

    def _create(self) -> RecordingWriter:
        """Return a new file: behind those of a predecessor, beside those of another recorder."""
        while True:
            self.parts += 1
            try:
                return RecordingWriter(self.path)
            except FileExistsError:
                with claimed(self.path) as free:
                    if not free:
                        self.recorder, self.parts = self.recorder + 1, 0

    def _capture_ns(self, message: Message, now_ns: int) -> int:
        header = getattr(message, "header", None)
        if not isinstance(header, Stamp) or header.clock != self.clock.id:
            return now_ns
        return header.time_ns + self.wall.offset_ns


def begin(bus: Bus, folder: Path, limits: Limits) -> Session:
    """Return a session of the bus's flight; what killed recorders left in `folder` is completed.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for path in repair_all(folder):
        log.warning("%s was left incomplete by a recorder that was killed: repaired", path)
    saved = bus.flight_dir / SAVED
    layout = saved.read_text() if saved.is_file() else None
    identity = Identity(bus.flight, bus.robot, version("juncnet"), libraries(), layout)
    return Session(folder, identity, limits, bus.clock, WallClock(bus.clock))


def libraries() -> str:
    """Return Python and those of `LIBRARIES` that are installed, with their versions, as a line."""
    found = [f"Python {platform.python_version()}"]
    for name in LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return ", ".join(found)
