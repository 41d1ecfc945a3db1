"""The `Bus` over Zenoh: one session with the processes of this host, links to the vehicle's router.

On the vehicle, and where everything is on one host, there is only the first. Elsewhere
`juncnet.routes` says what is heard and told through the vehicle's router.
"""

import contextlib
import json
import os
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import zenoh

from juncnet.flight import Flight
from juncnet.frame_ports import FramePorts, FrameTransport
from juncnet.frames import FrameReader, FrameWriter
from juncnet.frames_wire import ENCODING
from juncnet.inbox import Inbox, Mailbox, Waitable
from juncnet.links import RemoteSettings
from juncnet.messages import Message, MessageError, Reply
from juncnet.process import ServiceProcess
from juncnet.routes import Routes
from juncnet.topics import FrameTopic, Request, Topic, health_topic
from juncnet.zenoh_clocks import ClockWatch, tell_time
from juncnet.zenoh_remote import RemoteLink
from juncnet.zenoh_travel import KEEP, declare_publisher, declare_subscriber

M = TypeVar("M", bound=Message)
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
        remote: RemoteSettings | None = None,
    ) -> None:
        super().__init__(flight, service, state_dir)
        self._lock = threading.RLock()
        self._publishers: dict[str, list[Any]] = {}
        self._declared: list[Any] = []
        self._subscribers: dict[int, list[Any]] = {}
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
        self._remote: RemoteLink | None = None
        if remote is not None:
            self._remote = RemoteLink(remote, self._health.error)
        self._routes = Routes(flight.processes, service)
        self._threads: list[threading.Thread] = []
        self._queries: list[queue.SimpleQueue[zenoh.Query | None]] = []
        self._clocks = self._watch_clocks()

    @property
    def session(self) -> zenoh.Session:
        """The session, for what the Bus contract does not cover."""
        return self._session

    def _watch_clocks(self) -> ClockWatch:
        self._declared.append(tell_time(self._session, self._clock))
        control = None if self._remote is None else self._remote.control
        if control is not None:
            control.when_open(lambda s: self._keep(tell_time(s, self._clock)))
        return ClockWatch(self._offsets, self._clock, self.robot, self._session, control)

    def _keep(self, declared: Any) -> None:
        self._declared.append(declared)

    # Publishing

    def publish(self, topic: Topic[M], message: M, robot: str | None = None) -> None:
        payload, attachment = message.encode()
        for publisher in self._publishers_of(topic, robot):
            try:
                publisher.put(payload, attachment=attachment)
            except zenoh.ZError as error:
                if self.running:
                    self._health.error(f"{topic.key}: not published: {error}")

    def wanted(self, topic: Topic[M]) -> bool:
        publishers = self._publishers_of(topic, None)
        return topic.qos in KEEP or any(p.matching_status.matching for p in publishers)

    def _publishers_of(self, topic: Topic[Any], robot: str | None) -> list[Any]:
        """Return the publisher for this host and, once that link is open, the one for others."""
        key = topic.expression(robot or self.robot)
        with self._lock:
            found = self._publishers.get(key)
            if found is not None:
                return found
            declared = [declare_publisher(self._session, topic, key)]
            self._publishers[key] = declared
        if self._remote is not None and self._routes.tells_there(key):
            self._remote.of(topic.qos).when_open(
                lambda session: declared.append(declare_publisher(session, topic, key))
            )
        return declared

    # Subscribing

    def subscribe(
        self, topic: Topic[M], capacity: int = 1, robot: str | None = None, wakes: bool = True
    ) -> Inbox[M]:
        inbox = Mailbox[M](self._wake, capacity, wakes)

        def received(sample: zenoh.Sample) -> None:
            try:
                message = topic.message.decode(*_content(sample))
                robot = topic.robot_of(str(sample.key_expr))
            except MessageError as error:
                self._health.error(f"{sample.key_expr}: {error}")
                return
            inbox.put(robot, message)

        self._inputs.append(inbox)
        if wakes:
            self._waking.append(inbox)
        key = topic.expression(robot or self.robot)
        subscribers = self._subscribers[id(inbox)] = []
        if self._remote is None or self._routes.hears_here(topic.publisher):
            subscribers.append(declare_subscriber(self._session, topic, key, received))
        if self._remote is not None and self._routes.hears_there(topic.publisher, key):
            self._remote.of(topic.qos).when_open(
                lambda session: subscribers.append(
                    declare_subscriber(session, topic, key, received)
                )
            )
        return inbox

    def unsubscribe(self, inbox: Inbox[Any]) -> None:
        self._inputs = [w for w in self._inputs if id(w) != id(inbox)]
        self._waking = [w for w in self._waking if id(w) != id(inbox)]
        for subscriber in self._subscribers.pop(id(inbox)):
            with contextlib.suppress(zenoh.ZError):
                subscriber.undeclare()

    def wait(self, timeout_s: float) -> bool:
        return self._wake.wait_for(lambda: any(w.ready for w in self._waking), timeout_s)

    # Requests

    def serve(self, request: Request[M], handler: Callable[[M], Reply]) -> None:
        queries: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        key = request.expression(self.robot)
        self._declared.append(self._session.declare_queryable(key, queries.put))
        if self._remote is not None:
            self._remote.control.when_open(
                lambda session: self._keep(session.declare_queryable(key, queries.put))
            )

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

    def request(
        self, request: Request[M], message: M, timeout_s: float = 5.0, robot: str | None = None
    ) -> Reply:
        deadline = time.monotonic() + timeout_s
        while self.running and (left := deadline - time.monotonic()) > 0:
            answers = self._asking(request).get(
                request.expression(robot or self.robot),
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

    def _asking(self, request: Request[Any]) -> zenoh.Session:
        """Return the session on which the server of `request` is reached."""
        if self._remote is None or not self._routes.is_elsewhere(request.server):
            return self._session
        return self._remote.control.session or self._session

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
        key = topic.expression(self.robot)
        self._declared.append(self._session.liveliness().declare_token(key))
        if self._remote is not None:
            self._remote.control.when_open(
                lambda session: self._keep(session.liveliness().declare_token(key))
            )

        def report() -> None:
            while self._wake.sleep(HEALTH_PERIOD_S):
                drops = sum(w.drops for w in self._inputs)
                linked = None if self._remote is None else self._remote.control.linked
                self._health.linked(linked)
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
        self._clocks.close()
        for queries in self._queries:
            queries.put(None)
        subscribers = [one for each in self._subscribers.values() for one in each]
        for declared in (*subscribers, *self._declared):
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        for thread in self._threads:
            thread.join(1.0)
        if self._remote is not None:
            self._remote.close()
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
