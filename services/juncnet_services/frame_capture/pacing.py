"""When the pictures of a recording are due, and how long a live camera waits before it retries."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from juncnet.clocks import NS_PER_S, Clock

LATE_S = 0.5
"""A recording later than this (the process was stopped) goes on from now instead of racing."""


class Pace(StrEnum):
    """How fast a recording is played."""

    REALTIME = "realtime"
    FASTEST = "fastest"


@dataclass
class Pacer:
    """Waits until pictures of a recording are due; times are seconds on its time line."""

    clock: Clock
    sleep: Callable[[float], None]
    pace: Pace
    _start_ns: int | None = None

    def wait(self, time_s: float, timeout_s: float) -> bool:
        """Wait until `time_s` is due, at most `timeout_s`; return whether it is due."""
        if self.pace is Pace.FASTEST:
            return True
        now_ns = self.clock.now_ns()
        ahead_s = self._ahead_s(time_s, now_ns)
        if ahead_s < -LATE_S:
            self._start_ns = now_ns - round(time_s * NS_PER_S)
        if ahead_s > 0:
            self.sleep(min(ahead_s, timeout_s))
        return ahead_s <= timeout_s

    def _ahead_s(self, time_s: float, now_ns: int) -> float:
        if self._start_ns is None:
            self._start_ns = now_ns - round(time_s * NS_PER_S)
        return time_s - (now_ns - self._start_ns) / NS_PER_S


@dataclass
class Backoff:
    """Exponential delays between attempts, `first_s` to `last_s`."""

    first_s: float = 0.5
    last_s: float = 8.0
    _next_s: float = 0.0

    def next_s(self) -> float:
        """Return the delay before the next attempt."""
        delay_s = self._next_s or self.first_s
        self._next_s = min(2 * delay_s, self.last_s)
        return delay_s

    def reset(self) -> None:
        """Begin with the shortest delay again: an attempt has succeeded."""
        self._next_s = 0.0
