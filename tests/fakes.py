"""The fake at the one seam: a `Bus` that plays a script and keeps what is published."""

import tempfile
from collections import defaultdict, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from juncnet.clocks import Offset
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import Message, Reply, Stamp
from juncnet.topics import FrameTopic, Request, Topic


class FakeClock:
    """A clock that only moves when told to."""

    id = "fake-clock"

    def __init__(self) -> None:
        self.ns = 1_000_000_000

    def now_ns(self) -> int:
        return self.ns

    def advance(self, seconds: float) -> None:
        self.ns += round(seconds * 1e9)


@dataclass
class FakeHealth:
    """Keeps what the service says of itself."""

    errors: list[str] = field(default_factory=list[str])
    counters: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    outputs: int = 0

    def error(self, text: str) -> None:
        self.errors.append(text)

    def set(self, counter: str, value: float) -> None:
        self.counters[counter] = value

    def add(self, counter: str, value: float = 1.0) -> None:
        self.counters[counter] += value

    def output(self, taken_ns: int, header: Stamp | None) -> None:
        self.outputs += 1


class FakeInbox:
    """Messages in order; `take` pulls the bus's script forward until something arrives."""

    def __init__(self, bus: "FakeBus", capacity: int) -> None:
        self.bus, self.capacity = bus, capacity
        self.waiting: deque[tuple[str, Any]] = deque()
        self.newest: Any = None

    def put(self, robot: str, message: Any) -> None:
        self.newest = message
        self.waiting.append((robot, message))
        own = [item for item in self.waiting if item[0] == robot]
        if len(own) > self.capacity:
            self.waiting.remove(own[0])

    def take(self, timeout_s: float = 0.0) -> Any:
        if not self.waiting and timeout_s > 0:
            self.bus.wait(timeout_s)
        return self.waiting.popleft()[1] if self.waiting else None

    def drain(self) -> list[tuple[str, Any]]:
        items = list(self.waiting)
        self.waiting.clear()
        return items

    def __iter__(self) -> Iterator[Any]:
        while self.bus.running:
            message = self.take(1.0)
            if message is not None:
                yield message


class FakeWriter:
    """Keeps the frames sent, copied."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []

    def loan(self, layout: FrameLayout) -> "FakeLoan":
        return FakeLoan(self, layout)

    def send(self, frame: Frame) -> None:
        self.sent.append(Frame(frame.header, frame.layout, frame.pixels.copy()))


class FakeLoan:
    def __init__(self, writer: FakeWriter, layout: FrameLayout) -> None:
        self.writer, self.layout = writer, layout
        self.pixels = np.zeros(layout.nbytes, np.uint8)

    def send(self, header: Stamp) -> None:
        self.writer.sent.append(Frame(header, self.layout, self.pixels))


class FakeReader:
    def __init__(self, inbox: FakeInbox) -> None:
        self.inbox = inbox

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Frame | None, None, None]:
        yield self.inbox.take(timeout_s)


ScriptItem = tuple[Any, Any] | float | Callable[["FakeBus"], None]


class FakeBus:
    """A bus that delivers `script` step by step: (topic, message or Frame), seconds, or a callable.

    Whoever waits receives the next step; seconds advance the clock (a wait that meets them times
    out); a callable is called with the bus. When the script has ended and all inboxes are empty,
    `running` is False. `published[topic.key]` holds the messages; `frames[topic.key]` the frames.
    """

    def __init__(
        self,
        script: Sequence[ScriptItem] = (),
        service: str = "service",
        directory: Path | None = None,
        subscribers: bool = True,
    ) -> None:
        self.robot, self.service, self.flight, self.epoch = "robot", service, "flight-1", 1
        self.clock = FakeClock()
        self.health = FakeHealth()
        self.offsets: dict[str, Offset] = {}
        self.flight_dir = self.state_dir = directory or Path(tempfile.mkdtemp(prefix="juncnet-"))
        self.published: dict[str, list[Any]] = defaultdict(list)
        self.published_as: list[tuple[str, str, Any]] = []
        self.frames: dict[str, list[Frame]] = {}
        self.handlers: dict[str, Callable[[Any], Reply]] = {}
        self.subscribers = subscribers
        self._script = deque(script)
        self._inboxes: dict[str, list[FakeInbox]] = defaultdict(list)
        self._sequence = 0

    @property
    def running(self) -> bool:
        return bool(self._script) or any(i.waiting for b in self._inboxes.values() for i in b)

    def stamp(self) -> Stamp:
        self._sequence += 1
        return Stamp(
            epoch=self.epoch,
            sequence=self._sequence,
            time_ns=self.clock.now_ns(),
            clock=self.clock.id,
        )

    def publish(self, topic: Topic[Any], message: Message, robot: str | None = None) -> None:
        assert isinstance(message, topic.message), f"{topic.key} carries {topic.message}"
        self.published[topic.key].append(message)
        self.published_as.append((robot or self.robot, topic.key, message))

    def wanted(self, topic: Topic[Any]) -> bool:
        return self.subscribers

    def subscribe(
        self,
        topic: Topic[Any],
        capacity: int = 1,
        robot: str | None = None,
        wakes: bool = True,
    ) -> Any:
        inbox = FakeInbox(self, capacity)
        self._inboxes[topic.key].append(inbox)
        return inbox

    def serve(self, request: Request[Any], handler: Callable[[Any], Reply]) -> None:
        self.handlers[request.key] = handler

    def unsubscribe(self, inbox: Any) -> None:
        for boxes in self._inboxes.values():
            boxes[:] = [box for box in boxes if box is not inbox]

    def request(
        self,
        request: Request[Any],
        message: Message,
        timeout_s: float = 5.0,
        robot: str | None = None,
    ) -> Reply:
        return self.handlers[request.key](message)

    def frames_out(self, topic: FrameTopic) -> Any:
        writer = FakeWriter()
        self.frames[topic.key] = writer.sent
        return writer

    def frames_in(self, topic: FrameTopic, wakes: bool = False) -> Any:
        inbox = FakeInbox(self, 1)
        self._inboxes[topic.key].append(inbox)
        return FakeReader(inbox)

    def wait(self, timeout_s: float) -> bool:
        if any(i.waiting for boxes in self._inboxes.values() for i in boxes):
            return True
        while self._script:
            step = self._script.popleft()
            if isinstance(step, (int, float)):
                self.clock.advance(float(step))
                return False
            if callable(step):
                step(self)
                continue
            target, message = step
            robot = self.robot
            if isinstance(target, tuple):
                robot, target = cast("tuple[str, Any]", target)
            for inbox in self._inboxes[target.key]:
                inbox.put(robot, message)
            return True
        return False
