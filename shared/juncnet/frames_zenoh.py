"""Frames through Zenoh: the whole frame is one payload. Works everywhere, copies the pixels twice.

No Zenoh here: the bus gives a function that puts bytes and calls `ZenohFrameReader.put`.
"""

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame, FrameLayout
from juncnet.frames_wire import PREFIX_BYTES, PrefixPacker, SerialGate, number, unpack
from juncnet.health import HealthCounters
from juncnet.inbox import Wake
from juncnet.messages import MessageError, Stamp


class ZenohFrameWriter:
    """A `FrameWriter` that puts each frame as one payload through `put`, its prefix by `wake`."""

    def __init__(
        self, put: Callable[[bytearray], None], wake: Callable[[bytes], None], writer: int
    ) -> None:
        self._put, self._wake, self._prefixes = put, wake, PrefixPacker(writer)
        self._lock = threading.Lock()

    def loan(self, layout: FrameLayout) -> "ZenohFrameLoan":
        """Return memory for one frame."""
        layout.check()
        return ZenohFrameLoan(self, layout)

    def send(self, frame: Frame) -> None:
        """Send a frame: copies its pixels once here, and once more in Zenoh."""
        loan = self.loan(frame.layout)
        loan.pixels[:] = frame.pixels
        loan.send(frame.header)

    def finish(self, buffer: bytearray, header: Stamp, layout: FrameLayout) -> None:
        """Complete a loaned buffer with its prefix and put it."""
        with self._lock:
            prefix = self._prefixes.pack(header, layout)
            buffer[:PREFIX_BYTES] = prefix
            self._put(buffer)
            self._wake(prefix)


class ZenohFrameLoan:
    """Memory for one frame."""

    def __init__(self, writer: ZenohFrameWriter, layout: FrameLayout) -> None:
        self._writer, self._layout = writer, layout
        self._buffer = bytearray(PREFIX_BYTES + layout.nbytes)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """Flat uint8 array of `layout.nbytes`, writable until `send`."""
        return np.frombuffer(self._buffer, np.uint8, offset=PREFIX_BYTES)

    def send(self, header: Stamp) -> None:
        """Send the pixels under this header. Waits for no reader."""
        self._writer.finish(self._buffer, header, self._layout)


class ZenohFrameReader:
    """A `FrameReader` of whole frames that arrive as payloads; keeps the newest."""

    def __init__(self, wake: Wake, health: HealthCounters) -> None:
        self._wake, self._health = wake, health
        self._newest: tuple[Frame, int, int] | None = None
        self._gate = SerialGate()

    def put(self, payload: bytes) -> None:
        """Keep what arrived, if it is a frame; count it as an error if not."""
        try:
            header, layout, writer, serial = unpack(payload)
            frame = Frame(header, layout, np.frombuffer(payload, np.uint8, offset=PREFIX_BYTES))
        except MessageError as error:
            self._health.error(str(error))
            return
        with self._wake.condition:
            self._newest = (frame, writer, serial)
            self._wake.condition.notify_all()

    def announce(self, payload: bytes) -> None:
        """Check the prefix that observers get; it adds nothing to the whole frame."""
        try:
            number(payload)
        except MessageError as error:
            self._health.error(str(error))

    @property
    def ready(self) -> bool:
        """Whether a frame waits."""
        return self._newest is not None

    @property
    def drops(self) -> int:
        """Frames replaced before they were taken, since the start."""
        return self._gate.drops

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Frame | None]:
        """Give the newest frame not taken before, or None after `timeout_s`."""
        with self._wake.condition:
            self._wake.wait_for(lambda: self.ready, timeout_s)
            newest, self._newest = self._newest, None
        if newest is None:
            yield None
            return
        frame, writer, serial = newest
        self._gate.passed(writer, serial)
        yield frame
