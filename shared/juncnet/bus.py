"""The bus that services are written against, and its Zenoh implementation.

A service sees only `Bus`: it takes messages from inboxes, calls its core and publishes. Bad
payloads never reach it: they are counted as errors, reported in the health and dropped.
"""

import contextlib
import json
import os
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar

import zenoh
from zenoh import ext

from juncnet.clocks import Clock
from juncnet.flight import Flight
from juncnet.frame_ports import FramePorts, FrameTransport
from juncnet.frames import FrameReader, FrameWriter
from juncnet.frames_wire import ENCODING
from juncnet.health import HealthReport
from juncnet.inbox import Inbox, Mailbox, Waitable
from juncnet.messages import Message, MessageError, Reply, Stamp
from juncnet.process import ServiceProcess
from juncnet.topics import FrameTopic, Qos, Request, Topic, health_topic

__all__ = ["Bus", "HealthReport", "Inbox", "ZenohBus"]
M = TypeVar("M", bound=Message)


class Bus(Protocol):
    """The one seam between a service and the world."""

    @property
    def robot(self) -> str: ...
    @property
    def service(self) -> str: ...
    @property
    def flight(self) -> str:
        """Id of this start of the layout."""
        ...

    @property
    def epoch(self) -> int:
        """Epoch of this process as a source: wall clock in ns at its start."""
        ...

    @property
    def clock(self) -> Clock: ...
    @property
    def health(self) -> HealthReport: ...
    @property
    def running(self) -> bool:
        """False once the process shall end."""
        ...

    @property
    def flight_dir(self) -> Path:
        """Where this flight's state lives (count and phase, sockets); private to the user."""
        ...

    @property
    def state_dir(self) -> Path:
        """Where what outlives a flight lives (the stop latch), by robot; private to the user."""
        ...

    def stamp(self) -> Stamp:
        """Return a stamp of now with the next sequence of this process."""
        ...

    def publish(self, topic: Topic[M], message: M, robot: str | None = None) -> None:
        """Publish without ever blocking; `robot`: under another robot's name than ours."""
        ...

    def wanted(self, topic: Topic[M]) -> bool:
        """Return whether somebody subscribes to `topic` now."""
        ...

    def subscribe(
        self, topic: Topic[M], capacity: int = 1, robot: str | None = None, wakes: bool = True
    ) -> Inbox[M]:
        """Subscribe; `capacity` 1 keeps the newest. `robot` may be `*`: capacity is per robot.

        `wakes` False: `wait` does not return for it; it is read when something else came.
        """
        ...

    def serve(self, request: Request[M], handler: Callable[[M], Reply]) -> None:
        """Answer requests with `handler`, called in a thread of its own, one at a time."""
        ...

    def request(self, request: Request[M], message: M, timeout_s: float = 5.0) -> Reply:
        """Send a request and return the answer, or a refusal that says why none came."""
        ...

    def frames_out(self, topic: FrameTopic) -> FrameWriter:
        """Return the sending end of a frame topic."""
        ...

    def frames_in(self, topic: FrameTopic, wakes: bool = False) -> FrameReader:
        """Return the receiving end of a frame topic; `wakes`: `wait` returns for its frames too.

        A reader that only its own `take` wakes is spared one message a frame.
        """
        ...

    def wait(self, timeout_s: float) -> bool:
        """Wait until any inbox that wakes has a message; False after `timeout_s` or at shutdown."""
        ...


_PRIORITIES = {
    Qos.COMMAND: zenoh.Priority.REAL_TIME,
    Qos.FLIGHT: zenoh.Priority.INTERACTIVE_HIGH,
    Qos.EVENT: zenoh.Priority.DATA_HIGH,
    Qos.KEPT: zenoh.Priority.DATA_HIGH,
    Qos.BULK: zenoh.Priority.BACKGROUND,
}
_KEEP = {Qos.EVENT: 256, Qos.KEPT: 1}
"""How many samples late joiners get."""
_HEARTBEAT_S = 0.5
"""How soon a missed last event is noticed."""
HEALTH_PERIOD_S = 1.0
POLLED = 256
"""Samples that wait, the newest ones, where nobody is called for each."""


class ZenohBus(ServiceProcess):
    """A `Bus` over a Zenoh session; `close` it, or use it in a `with` block.

    Zenoh calls back in threads of its own; there messages are decoded and put into inboxes.
    """

    def __init__(
        self,
        settings: dict[str, Any],
        flight: Flight,
        service: str,
        state_dir: Path,
        frames: FrameTransport = "auto",
    ) -> None:
        super().__init__(flight, service, state_dir)
        self._lock = threading.RLock()
        self._publishers: dict[str, Any] = {}
        self._declared: list[Any] = []
        self._inputs: list[Waitable] = []
        self._waking: list[Waitable] = []
        self._frames = FramePorts(
            flight,
            frames,
            self._epoch,
            (self._wake, self._health),
            (self._send_bytes, self._receive_bytes, self._poll_bytes),
        )
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
        self._threads: list[threading.Thread] = []
        self._queries: list[queue.SimpleQueue[zenoh.Query | None]] = []

    @property
    def session(self) -> zenoh.Session:
        """The session, for what the Bus contract does not cover."""
        return self._session

    # Publishing

    def publish(self, topic: Topic[M], message: M, robot: str | None = None) -> None:
        payload, attachment = message.encode()
        publisher = self._publisher(topic, robot)
        try:
            publisher.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            if self.running:
                self._health.error(f"{topic.key}: not published: {error}")

    def wanted(self, topic: Topic[M]) -> bool:
        publisher = self._publisher(topic, None)
        if topic.qos in _KEEP:
            return True
        return bool(publisher.matching_status.matching)

    def _publisher(self, topic: Topic[Any], robot: str | None) -> Any:
        key = topic.expression(robot or self.robot)
        with self._lock:
            if key not in self._publishers:
                self._publishers[key] = self._declare_publisher(topic, key)
            return self._publishers[key]

    def _declare_publisher(self, topic: Topic[Any], key: str) -> Any:
        travel: dict[str, Any] = {
            "encoding": topic.message.encoding(),
            "priority": _PRIORITIES[topic.qos],
            "congestion_control": zenoh.CongestionControl.DROP,
            "express": topic.qos is not Qos.BULK,
        }
        if topic.qos not in _KEEP:
            return self._session.declare_publisher(key, **travel)
        return ext.declare_advanced_publisher(
            self._session,
            key,
            **travel,
            cache=ext.CacheConfig(_KEEP[topic.qos]),
            sample_miss_detection=ext.MissDetectionConfig(
                heartbeat=_HEARTBEAT_S, sporadic_heartbeat=None
            ),
            publisher_detection=True,
        )

    # Subscribing

    def subscribe(
        self, topic: Topic[M], capacity: int = 1, robot: str | None = None, wakes: bool = True
    ) -> Inbox[M]:
        inbox = Mailbox[M](self._wake, capacity)

        def received(sample: zenoh.Sample) -> None:
            try:
                message = topic.message.decode(*_content(sample))
            except MessageError as error:
                self._health.error(f"{sample.key_expr}: {error}")
                return
            inbox.put(str(sample.key_expr).split("/")[1], message)

        self._inputs.append(inbox)
        if wakes:
            self._waking.append(inbox)
        key = topic.expression(robot or self.robot)
        if topic.qos in _KEEP:
            self._declared.append(
                ext.declare_advanced_subscriber(
                    self._session,
                    key,
                    received,
                    history=ext.HistoryConfig(
                        detect_late_publishers=True, max_samples=_KEEP[topic.qos]
                    ),
                    recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                )
            )
        else:
            self._declared.append(self._session.declare_subscriber(key, received))
        return inbox

    def wait(self, timeout_s: float) -> bool:
        return self._wake.wait_for(lambda: any(w.ready for w in self._waking), timeout_s)

    # Requests

    def serve(self, request: Request[M], handler: Callable[[M], Reply]) -> None:
        queries: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        key = request.expression(self.robot)
        queryable = self._session.declare_queryable(key, queries.put)
        self._declared.append(queryable)

        def answer_all() -> None:
            while (query := queries.get()) is not None:
                reply, _ = self._answer(request, handler, query).encode()
                with contextlib.suppress(zenoh.ZError):
                    # Zenoh leaves the results of its commands without a type.
                    query.reply(  # pyright: ignore[reportUnknownMemberType]
                        key, reply, encoding=Reply.encoding()
                    )
                query.drop()  # pyright: ignore[reportUnknownMemberType]

        self._start(answer_all, f"serve {request.key}")
        self._queries.append(queries)

    def _answer(
        self, request: Request[M], handler: Callable[[M], Reply], query: zenoh.Query
    ) -> Reply:
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            return handler(request.message.decode(payload))
        except Exception as error:
            self._health.error(f"{request.key}: {error}")
            return Reply(accepted=False, reason=f"{error}"[:4000])

    def request(self, request: Request[M], message: M, timeout_s: float = 5.0) -> Reply:
        deadline = time.monotonic() + timeout_s
        while self.running and (left := deadline - time.monotonic()) > 0:
            answers = self._session.get(
                request.expression(self.robot),
                payload=message.encode()[0],
                encoding=message.encoding(),
                timeout=left,
            )
            for answer in answers:
                if answer.ok is not None:
                    return Reply.decode(answer.ok.payload.to_bytes())
            self._wake.wait_for(lambda: False, 0.05)
        return Reply(
            accepted=False,
            reason=f"{request.key}: no answer within {timeout_s:g} s: is {request.server} running?",
        )

    # Frames

    def frames_out(self, topic: FrameTopic) -> FrameWriter:
        return self._frames.writer(topic.expression(self.robot))

    def frames_in(self, topic: FrameTopic, wakes: bool = False) -> FrameReader:
        reader = self._frames.reader(topic.expression(self.robot), wakes)
        self._inputs.append(reader)
        if wakes:
            self._waking.append(reader)
        return reader

    def _send_bytes(self, key: str) -> Callable[[bytes | bytearray], None]:
        publisher: Any = self._session.declare_publisher(
            key,
            encoding=ENCODING,
            priority=zenoh.Priority.DATA,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )
        return publisher.put

    def _receive_bytes(self, key: str, put: Callable[[bytes], None]) -> None:
        subscriber = self._session.declare_subscriber(key, lambda s: put(s.payload.to_bytes()))
        self._declared.append(subscriber)

    def _poll_bytes(self, key: str) -> Callable[[], bytes | None]:
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(POLLED))
        self._declared.append(subscriber)

        def poll() -> bytes | None:
            sample = subscriber.try_recv()
            return None if sample is None else sample.payload.to_bytes()

        return poll

    # Life

    @property
    def connected(self) -> bool:
        """Whether any other process is linked with this one."""
        info = self._session.info
        return bool(info.peers_zid() or info.routers_zid())

    def report_health(self) -> None:
        """Show a liveliness token and publish `health/<service>` once a second until the end."""
        topic = health_topic(self._service)
        token = self._session.liveliness().declare_token(topic.expression(self.robot))
        self._declared.append(token)

        def report() -> None:
            while not self._wake.wait_for(lambda: False, HEALTH_PERIOD_S) and self.running:
                drops = sum(w.drops for w in self._inputs)
                health = self._health.report(self.stamp(), self.flight, os.getpid(), drops)
                self.publish(topic, health)

        self._start(report, "health")

    def alive(self) -> set[str]:
        """Return the services of the flight whose processes are connected now."""
        tokens = self._session.liveliness().get(health_topic("*").expression(self.robot), timeout=1)
        return {str(t.ok.key_expr).rsplit("/", 1)[1] for t in tokens if t.ok is not None}

    def _start(self, work: Callable[[], None], name: str) -> None:
        thread = threading.Thread(target=work, name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    def close(self) -> None:
        """Leave the bus: nothing is received or sent any more, shared memory is given back."""
        self.stop()
        for queries in self._queries:
            queries.put(None)
        for declared in self._declared:
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        for thread in self._threads:
            thread.join(1.0)
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # pyright: ignore[reportUnknownMemberType]
        self._frames.close()

    def __enter__(self) -> "ZenohBus":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _content(sample: zenoh.Sample) -> tuple[bytes, bytes | None]:
    attachment = sample.attachment
    return sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()
