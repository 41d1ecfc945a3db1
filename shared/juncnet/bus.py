"""The bus that services are written against; `juncnet.zenoh_bus` implements it.

A service sees only `Bus`: it takes messages from inboxes, calls its core and publishes. Bad
payloads never reach it: they are counted as errors, reported in the health and dropped.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeVar

from juncnet.clocks import Clock, Offset
from juncnet.frames import FrameReader, FrameWriter
from juncnet.health import HealthReport
from juncnet.inbox import Inbox
from juncnet.messages import Message, Reply, Stamp
from juncnet.topics import FrameTopic, Request, Topic

__all__ = ["Bus", "HealthReport", "Inbox"]
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
        """Epoch of this process as a source: monotonic time of its host in ns at its start."""
        ...

    @property
    def clock(self) -> Clock: ...
    @property
    def offsets(self) -> Mapping[str, Offset]:
        """Measured offsets of other hosts' clocks, by clock, as of now; unknown ones are missing.

        To look one up is to have it measured from then on.
        """
        ...

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

    def unsubscribe(self, inbox: Inbox[Any]) -> None:
        """End a subscription: nothing more is put into its inbox, and publishers may rest."""
        ...

    def serve(self, request: Request[M], handler: Callable[[M], Reply]) -> None:
        """Answer requests with `handler`, called in a thread of its own, one at a time."""
        ...

    def request(
        self, request: Request[M], message: M, timeout_s: float = 5.0, robot: str | None = None
    ) -> Reply:
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
