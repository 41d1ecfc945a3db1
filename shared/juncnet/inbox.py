"""Waiting: what arrives in any thread, kept until the service takes it.

One `Wake` a process: every mailbox and frame reader shares it, so that a service can wait for
whichever comes first. Signal handlers may stop it: its lock is reentrant.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Generic, Protocol, TypeVar

from juncnet.messages import Message

M = TypeVar("M", bound=Message)


class Inbox(Protocol[M]):
    """What arrived on a subscription. Full inboxes drop their oldest message and count it."""

    def take(self, timeout_s: float = 0.0) -> M | None:
        """Remove and return the oldest waiting message; None after `timeout_s` or at shutdown."""
        ...

    def drain(self) -> list[tuple[str, M]]:
        """Remove and return all that waits, oldest first, each with the robot that it came from."""
        ...

    @property
    def newest(self) -> M | None:
        """The newest message ever received, taken or not."""
        ...

    def __iter__(self) -> Iterator[M]:
        """Take messages until shutdown, waiting for each."""
        ...


class Waitable(Protocol):
    """Something that `Bus.wait` waits for."""

    @property
    def ready(self) -> bool:
        """Whether something waits to be taken."""
        ...

    @property
    def drops(self) -> int:
        """Inputs replaced by newer ones before they were taken, since the start."""
        ...


class Wake:
    """The condition on which everything of one bus waits, and whether the process runs on."""

    def __init__(self) -> None:
        self.condition = threading.Condition(threading.RLock())
        self._ended = threading.Condition(threading.RLock())
        self._running = True

    @property
    def running(self) -> bool:
        """False once `stop` was called."""
        return self._running

    def stop(self) -> None:
        """End all waiting, now and later. Safe in a signal handler."""
        with self.condition:
            self._running = False
            self.condition.notify_all()
        with self._ended:
            self._ended.notify_all()

    def sleep(self, timeout_s: float) -> bool:
        """Wait so long, whatever arrives; return False, and early, at shutdown."""
        with self._ended:
            if self._running:
                self._ended.wait(timeout_s)
        return self._running

    def wait_for(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until `ready()`, at most `timeout_s`; return `ready()`. Ends early at shutdown."""
        deadline = time.monotonic() + timeout_s
        with self.condition:
            while not ready():
                left = deadline - time.monotonic()
                if left <= 0 or not self._running:
                    return False
                self.condition.wait(left)
            return True


class Mailbox(Generic[M]):
    """An `Inbox`: at most `capacity` messages of each robot; the oldest gives way, counted.

    Without `wakes` a message wakes only who waits in `take`: a thread that is woken for nothing
    costs the process as much as the message.
    """

    def __init__(self, wake: Wake, capacity: int, wakes: bool = True) -> None:
        if capacity < 1:
            raise ValueError(f"capacity: {capacity}, needs at least 1")
        self._wake, self._capacity, self._wakes = wake, capacity, wakes
        self._takers = 0
        self._waiting: deque[tuple[str, M]] = deque()
        self._of_robot: Counter[str] = Counter()
        self._newest: M | None = None
        self._drops = 0

    def put(self, robot: str, message: M) -> None:
        """Add a message that came from `robot`; called by the transport, in any thread."""
        with self._wake.condition:
            if self._of_robot[robot] >= self._capacity:
                oldest = next(i for i, (name, _) in enumerate(self._waiting) if name == robot)
                del self._waiting[oldest]
                self._of_robot[robot] -= 1
                self._drops += 1
            self._waiting.append((robot, message))
            self._of_robot[robot] += 1
            self._newest = message
            if self._wakes or self._takers:
                self._wake.condition.notify_all()

    @property
    def ready(self) -> bool:
        """Whether a message waits."""
        return bool(self._waiting)

    @property
    def drops(self) -> int:
        """Messages that gave way to newer ones, since the start."""
        return self._drops

    @property
    def newest(self) -> M | None:
        """The newest message ever received, taken or not."""
        return self._newest

    def take(self, timeout_s: float = 0.0) -> M | None:
        """Remove and return the oldest waiting message; None after `timeout_s` or at shutdown."""
        with self._wake.condition:
            self._takers += 1
            try:
                if not self._wake.wait_for(lambda: self.ready, timeout_s):
                    return None
            finally:
                self._takers -= 1
            robot, message = self._waiting.popleft()
            self._of_robot[robot] -= 1
            return message

    def drain(self) -> list[tuple[str, M]]:
        """Remove and return all that waits, oldest first, each with its robot."""
        with self._wake.condition:
            items = list(self._waiting)
            self._waiting.clear()
            self._of_robot.clear()
            return items

    def __iter__(self) -> Iterator[M]:
        while self._wake.running:
            message = self.take(1.0)
            if message is not None:
                yield message
