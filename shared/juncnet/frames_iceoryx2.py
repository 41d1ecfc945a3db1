"""Frames through iceoryx2: loaned shared memory, read in place by every process of the flight.

A sample is reference-counted, so none is overwritten while it is read; `safe_overflow` with a
buffer of one keeps the newest only. The flight has a root and a prefix of its own in iceoryx2's
configuration: flights do not meet, and what a killed flight left in shared memory is known by name.
"""

import contextlib
import ctypes
import fcntl
import importlib
import importlib.util
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from juncnet.flight import SOCKET_PATH_LIMIT, Flight
from juncnet.frames import Frame, FrameLayout
from juncnet.frames_wire import PREFIX_BYTES, PrefixPacker, SerialGate, number, unpack
from juncnet.health import HealthCounters
from juncnet.inbox import Wake
from juncnet.messages import MessageError, Stamp

MAX_READERS = 32
MAX_WRITERS = 8
"""More than one, because a killed writer counts until its remains are cleared."""
POLL_S = 0.1
"""How long a lost wake-up, or the end of the process, can find a reader asleep."""
HEAD_START_S = 0.0003
"""The bus tells of a frame so much later than its readers are woken: its threads, in the writer's
process and in theirs, would cost them 0.2 ms on two cores."""
LONGEST_EVENT = 39 + len("_.event")
"""Characters of an event's socket after the flight's tag: a number of 128 bits."""
SHARED_MEMORY = Path("/dev/shm")


def available() -> bool:
    """Return whether iceoryx2 is installed here."""
    return importlib.util.find_spec("iceoryx2") is not None


def root(flight: Flight) -> Path:
    """Return where iceoryx2's files of this flight lie; elsewhere if its sockets would not fit."""
    inside = flight.directory / "iox"
    if len(str(inside / flight.tag)) + LONGEST_EVENT <= SOCKET_PATH_LIMIT:
        return inside
    return Path(tempfile.gettempdir()) / flight.tag


def _locks() -> Path:
    return SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir())


def _is_at(lock: TextIO, path: Path) -> bool:
    """Return whether the open file is still the one at `path`: a sweep may have removed it."""
    return path.exists() and os.path.samestat(os.fstat(lock.fileno()), path.stat())


def join_lock(tag: str) -> TextIO:
    """Return the lock, held, that says: a process of the flight with this tag uses its memory."""
    path = _locks() / f"{tag}_lock"
    while True:
        lock = path.open("a")
        fcntl.flock(lock, fcntl.LOCK_SH)
        if _is_at(lock, path):
            return lock
        lock.close()


def sweep(flight: Flight | None = None) -> None:
    """Remove what flights without a living process left in shared memory.

    Any flight of this user is swept, its directory may be long gone; `flight` with its files too,
    if its directory is one: elsewhere a folder of this name may be the user's own.
    """
    for path in _locks().glob("jn????????_lock"):
        tag = path.name.removesuffix("_lock")
        with contextlib.suppress(OSError), path.open("a") as lock:  # OSError: alive, or not ours
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not _is_at(lock, path):
                continue
            if flight is not None and flight.tag == tag and flight.is_saved:
                shutil.rmtree(root(flight), ignore_errors=True)
            shutil.rmtree(Path(tempfile.gettempdir()) / tag, ignore_errors=True)
            for leftover in path.parent.glob(f"{tag}_*"):
                leftover.unlink(missing_ok=True)


class IceoryxNode:
    """This process's part in the flight's shared memory."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        sweep(flight)
        self._lock = join_lock(flight.tag)
        root(flight).mkdir(mode=0o700, exist_ok=True)
        self._iox2: Any = importlib.import_module("iceoryx2")
        iox2 = self._iox2
        iox2.set_log_level(iox2.LogLevel.Error)
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(f"{flight.tag}_")
        config.global_cfg.root_path = iox2.Path.new(str(root(flight)))
        self._node: Any = (
            iox2.NodeBuilder.new()
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
            .config(config)
            .create(iox2.ServiceType.Ipc)
        )
        self._ports: list[Any] = []

    def _service(self, key: str) -> Any:
        iox2 = self._iox2
        return (
            self._node.service_builder(iox2.ServiceName.new(key))
            .publish_subscribe(iox2.Slice[ctypes.c_uint8])
            .payload_alignment(iox2.Alignment.new(64))
            .max_subscribers(MAX_READERS)
            .max_publishers(MAX_WRITERS)
            .max_nodes(MAX_READERS + MAX_WRITERS)
            .subscriber_max_buffer_size(1)
            .subscriber_max_borrowed_samples(2)
            .enable_safe_overflow(True)
            .history_size(0)
            .open_or_create()
        )

    def _event(self, key: str) -> Any:
        return (
            self._node.service_builder(self._iox2.ServiceName.new(key))
            .event()
            .max_listeners(MAX_READERS)
            .max_notifiers(MAX_WRITERS)
            .max_nodes(MAX_READERS + MAX_WRITERS)
            .open_or_create()
        )

    def notifier(self, key: str) -> Callable[[], None]:
        """Return a function that wakes the listeners of `key`, never blocking.

        A listener that was killed is no error: whoever cannot be woken so is woken by the bus.
        """
        notifier = self._event(key).notifier_builder().create()
        self._ports.append(notifier)

        def notify() -> None:
            try:
                notifier.notify()
            except self._iox2.NotifierNotifyError:
                return

        return notify

    def listener(self, key: str) -> Callable[[float], None]:
        """Return a function that sleeps until the notifier of `key`, at most some seconds.

        Waiting for the writer directly spares the way through Zenoh's threads.
        """
        listener = self._event(key).listener_builder().create()
        self._ports.append(listener)

        def sleep(timeout_s: float) -> None:
            duration = self._iox2.Duration.from_secs_f64(timeout_s)
            try:
                listener.timed_wait(duration)
            except self._iox2.ListenerWaitError:
                return  # a process that was stopped and continued finds its wait interrupted

        return sleep

    def publisher(self, key: str) -> Any:
        """Return an iceoryx2 publisher of samples of any size under `key`."""
        iox2 = self._iox2
        port = (
            self._service(key)
            .publisher_builder()
            .initial_max_slice_len(PREFIX_BYTES)
            .allocation_strategy(iox2.AllocationStrategy.PowerOfTwo)
            .max_loaned_samples(2)
            .create()
        )
        self._ports.append(port)
        return port

    def subscriber(self, key: str) -> Any:
        """Return an iceoryx2 subscriber of `key`."""
        port = self._service(key).subscriber_builder().buffer_size(1).create()
        self._ports.append(port)
        return port

    def close(self) -> None:
        """Leave; the last one to leave removes what is left."""
        for port in self._ports:
            port.delete()
        self._ports.clear()
        self._node = None
        self._lock.close()
        sweep(self._flight)


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

    A class, for a generator that is resumed costs each frame 0.01 ms more.
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
