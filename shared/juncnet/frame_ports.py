"""Which transport carries the frames of this host, and the ends of it in one process."""

import threading
from collections.abc import Callable
from typing import Literal

from juncnet.flight import Flight
from juncnet.frames_iceoryx2 import IceoryxFrameReader, IceoryxFrameWriter
from juncnet.frames_wire import PIXELS_KEY
from juncnet.frames_zenoh import ZenohFrameReader, ZenohFrameWriter
from juncnet.health import HealthCounters
from juncnet.iceoryx_node import IceoryxNode, available
from juncnet.inbox import Wake

FrameTransport = Literal["auto", "iceoryx2", "zenoh", "none"]
"""How pictures travel; none: none are read, as by who is no part of the flight."""
Send = Callable[[bytes | bytearray], None]
Receive = Callable[[bytes], None]
Poll = Callable[[], bytes | None]


class FramePorts:
    """Makes writers and readers of frames; `declare` holds the bus's ways
    to send, to be called for what comes, and to look for what came.

    With either transport the prefix of each frame goes out under the topic's own key: it tells
    observers, and wakes readers that wait for other things too. Whole frames through Zenoh go
    out under `PIXELS_KEY` below it.
    """

    def __init__(
        self,
        flight: Flight,
        transport: FrameTransport,
        epoch: int,
        listening: tuple[Wake, HealthCounters],
        declare: tuple[
            Callable[[str], Send], Callable[[str, Receive], None], Callable[[str], Poll]
        ],
    ) -> None:
        self._flight, self._epoch, self._listening = flight, epoch, listening
        self._declare_send, self._declare_receive, self._declare_poll = declare
        self._reads = transport != "none"
        self._shared = transport == "iceoryx2" or (transport == "auto" and available())
        self._node: IceoryxNode | None = None
        self._lock = threading.Lock()

    def writer(self, key: str) -> IceoryxFrameWriter | ZenohFrameWriter:
        """Return the sending end of `key`."""
        wake = self._declare_send(key)
        if self._shared:
            return IceoryxFrameWriter(self._shared_memory(), key, wake, self._epoch)
        return ZenohFrameWriter(self._declare_send(f"{key}/{PIXELS_KEY}"), wake, self._epoch)

    def reader(self, key: str, wakes: bool) -> IceoryxFrameReader | ZenohFrameReader:
        """Return the receiving end of `key`; `wakes`: each frame wakes this process's `Wake`."""
        if self._shared:
            announced = None if wakes else self._declare_poll(key)
            shared = IceoryxFrameReader(self._shared_memory(), key, *self._listening, announced)
            if wakes:
                self._declare_receive(key, shared.announce)
            return shared
        reader = ZenohFrameReader(*self._listening)
        if not self._reads:
            return reader
        self._declare_receive(f"{key}/{PIXELS_KEY}", reader.put)
        self._declare_receive(key, reader.announce)
        return reader

    def _shared_memory(self) -> IceoryxNode:
        with self._lock:
            if self._node is None:
                self._node = IceoryxNode(self._flight)
            return self._node

    def close(self) -> None:
        """Give back what this process has of the shared memory."""
        with self._lock:
            if self._node is not None:
                self._node.close()
                self._node = None
