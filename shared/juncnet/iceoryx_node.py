"""A process's part in the shared memory of its flight, through iceoryx2.

The flight has a root and a prefix of its own in iceoryx2's configuration: flights do not meet, and
what a killed flight left in shared memory is known by name.
"""

import contextlib
import ctypes
import fcntl
import importlib
import importlib.util
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from juncnet.flight import SOCKET_PATH_LIMIT, Flight
from juncnet.frames_wire import PREFIX_BYTES

MAX_READERS = 32
MAX_WRITERS = 8
"""More than one, because a killed writer counts until its remains are cleared."""
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
            try:  # no `suppress`, here and below: it stands between a frame and its readers
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
