"""The bus that services are written against, and its Zenoh implementation.

A service sees only `Bus`: it takes messages from inboxes, calls its core and publishes. Bad
payloads never reach it: they are counted as errors, reported in the health and dropped.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol, TypeVar

from juncnet.clocks import Clock
from juncnet.frames import FrameReader, FrameWriter
from juncnet.messages import Message, Reply, Stamp
from juncnet.topics import FrameTopic, Request, Topic

M = TypeVar("M", bound=Message)
M_co = TypeVar("M_co", bound=Message, covariant=True)


class Inbox(Protocol[M_co]):
    """What arrived on a subscription. Full inboxes drop their oldest message and count it."""

    def take(self, timeout_s: float = 0.0) -> M_co | None:
        """Remove and return the oldest waiting message; None after `timeout_s` or at shutdown."""
        ...

    def drain(self) -> list[tuple[str, M_co]]:
        """Remove and return all that waits, oldest first, each with the robot that it came from."""
        ...

    @property
    def newest(self) -> M_co | None:
        """The newest message ever received, taken or not."""
        ...

    def __iter__(self) -> Iterator[M_co]:
        """Take messages until shutdown, waiting for each."""
        ...


class HealthReport(Protocol):
    """What a service tells about itself; the bus publishes it once a second."""

    def error(self, text: str) -> None:
        """Count a failure that was survived, log it (rate-limited) and show it as `last_error`."""
        ...

    def set(self, counter: str, value: float) -> None:
        """Set one of the service's own counters."""
        ...

    def add(self, counter: str, value: float = 1.0) -> None:
        """Add to one of the service's own counters."""
        ...

    def output(self, taken_ns: int, header: Stamp | None) -> None:
        """Note that a main output was published for what was taken at `taken_ns`."""
        ...


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

    def subscribe(self, topic: Topic[M], capacity: int = 1, robot: str | None = None) -> Inbox[M]:
        """Subscribe; `capacity` 1 keeps the newest. `robot` may be `*`: capacity is per robot."""
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

    def frames_in(self, topic: FrameTopic) -> FrameReader:
        """Return the receiving end of a frame topic."""
        ...

    def wait(self, timeout_s: float) -> bool:
        """Wait until any inbox has a message; False after `timeout_s` or at shutdown."""
        ...
