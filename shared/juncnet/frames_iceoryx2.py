"""Frames through iceoryx2: loaned shared memory, read in place by every process of the flight.

A sample is reference-counted, so none is overwritten while it is read; `safe_overflow` with a
buffer of one keeps the newest only.
"""

import ctypes
import threading
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame, FrameLayout
from juncnet.frames_wire import PREFIX_BYTES, PrefixPacker, SerialGate, number, unpack
from juncnet.health import HealthCounters
from juncnet.iceoryx_node import IceoryxNode
from juncnet.inbox import Wake
from juncnet.messages import MessageError, Stamp

POLL_S = 0.1
"""How long a lost wake-up, or the end of the process, can find a reader asleep."""
HEAD_START_S = 0.0003
"""The bus tells of a frame so much later than its readers are woken: its threads, in the writer's
process and in theirs, would cost them 0.2 ms on two cores."""


class IceoryxFrameWriter:
    """A `FrameWriter` into shared memory; `wake` puts the prefix of each frame sent."""

    def __init__(
        self, node: IceoryxNode, key: str, wake: Callable[[bytes], None], writer: int
    ) -> None:
        self._publisher, self._notify = node.publisher(key), node.notifier(key)
        self._wake, self._prefixes = wake, PrefixPacker(writer)
        self._lock = threading.Lock()

    def loan(self, layout: FrameLayout) -> "IceoryxFrameLoan":
        """Return shared memory for one frame."""
        layout.check()
        return IceoryxFrameLoan(
            self, layout, self._publisher.loan_slice_uninit(PREFIX_BYTES + layout.nbytes)
        )

    def send(self, frame: Frame) -> None:
        """Send a frame: copies its pixels once."""
        loan = self.loan(frame.layout)
        loan.pixels[:] = frame.pixels
        loan.send(frame.header)

    def finish(self, sample: Any, head: memoryview, header: Stamp, layout: FrameLayout) -> None:
        """Complete a loaned sample with its prefix, send it and wake the readers."""
        with self._lock:
            prefix = self._prefixes.pack(header, layout)
            head[:] = prefix
            sample.assume_init().send()
            self._notify()
            time.sleep(HEAD_START_S)
            self._wake(prefix)


class IceoryxFrameLoan:
    """Shared memory for one frame; given back unless sent."""

    def __init__(self, writer: IceoryxFrameWriter, layout: FrameLayout, sample: Any) -> None:
        self._writer, self._layout, self._sample = writer, layout, sample
        self._head, self._pixels = _parts(sample.payload_ptr, PREFIX_BYTES + layout.nbytes, True)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """Flat uint8 array of `layout.nbytes`, writable until `send`."""
        return self._pixels

    def send(self, header: Stamp) -> None:
        """Send the pixels under this header. Waits for no reader, but for `HEAD_START_S`."""
        self._writer.finish(self._sample, self._head, header, self._layout)


class IceoryxFrameReader:
    """A `FrameReader` of shared memory.

    The prefixes that the bus brings either wake whoever waits for other things too (`announce`),
    or are only checked after each frame (`announced` gives them): a thread that is called while
    the frame is taken would cost it 0.1 ms.
    """

    def __init__(
        self,
        node: IceoryxNode,
        key: str,
        wake: Wake,
        health: HealthCounters,
        announced: Callable[[], bytes | None] | None,
    ) -> None:
        self._subscriber, self._sleep = node.subscriber(key), node.listener(key)
        self._wake, self._health, self._announced = wake, health, announced
        self._woken = False
        self._gate = SerialGate()

    def announce(self, payload: bytes) -> None:
        """Wake: a frame was sent. Anything but the prefix of a frame is counted as an error."""
        try:
            writer, serial = number(payload)
        except MessageError as error:
            self._health.error(str(error))
            return
        with self._wake.condition:
            if not self._gate.is_taken(writer, serial):
                self._woken = True
                self._wake.condition.notify_all()

    @property
    def ready(self) -> bool:
        """Whether a frame was announced since the last `take`."""
        return self._woken

    @property
    def drops(self) -> int:
        """Frames replaced before they were taken, since the start."""
        return self._gate.drops

    def take(self, timeout_s: float) -> "IceoryxTake":
        """Return a context that gives the newest frame not taken before, in place.

        It gives None if there was none within `timeout_s`.
        """
        return IceoryxTake(self, *self._receive(timeout_s))

    def hear(self) -> None:
        """Check the prefixes that came through the bus meanwhile."""
        while self._announced is not None and (payload := self._announced()) is not None:
            self.announce(payload)

    def _receive(self, timeout_s: float) -> tuple[Any, Frame | None]:
        deadline = time.monotonic() + timeout_s
        while True:
            self._woken = False
            sample = self._subscriber.receive()
            if sample is not None:
                try:
                    return sample, self._frame(sample)
                except MessageError as error:
                    self._health.error(str(error))
                    sample.delete()
            left_s = deadline - time.monotonic()
            if left_s <= 0 or not self._wake.running:
                return None, None
            self._sleep(min(left_s, POLL_S))

    def _frame(self, sample: Any) -> Frame:
        length: int = sample.header.number_of_elements
        head, pixels = _parts(sample.payload_ptr, length, False)
        header, layout, writer, serial = unpack(bytes(head))
        frame = Frame(header, layout, pixels)
        self._gate.passed(writer, serial)
        return frame


class IceoryxTake:
    """A frame in shared memory until the `with` block ends.

    A class, for resuming a generator would be one thing more between waking and the frame.
    """

    __slots__ = ("_frame", "_reader", "_sample")

    def __init__(self, reader: IceoryxFrameReader, sample: Any, frame: Frame | None) -> None:
        self._reader, self._sample, self._frame = reader, sample, frame

    def __enter__(self) -> Frame | None:
        return self._frame

    def __exit__(self, *_: object) -> None:
        if self._sample is not None:
            self._sample.delete()
        self._reader.hear()


@lru_cache(maxsize=128)
def _parts(address: int, nbytes: int, writeable: bool) -> tuple[memoryview, NDArray[np.uint8]]:
    """Return the prefix and the pixels of the sample at `address`, without a copy.

    They do not keep the sample. iceoryx2 loans the same few samples again and again.

    Raises:
        MessageError: `nbytes` are less than a prefix.
    """
    if nbytes < PREFIX_BYTES:
        raise MessageError(f"Frame.prefix: {nbytes} bytes, needs {PREFIX_BYTES}")
    buffer: Any = (ctypes.c_uint8 * nbytes).from_address(address)
    view = np.frombuffer(buffer, np.uint8)
    view.flags.writeable = writeable
    return view[:PREFIX_BYTES].data, view[PREFIX_BYTES:]
