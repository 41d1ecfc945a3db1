"""When things are due, and how well the simulation keeps up with real time. Pure."""

from collections import deque
from dataclasses import dataclass, field

from juncnet.clocks import NS_PER_S

WINDOW_NS = NS_PER_S
"""Time over which the real-time factor is taken."""


@dataclass
class Pace:
    """Says when something of a fixed rate is due; what was missed is skipped, not made up for."""

    rate_hz: float
    _next_ns: int | None = None

    def due(self, now_ns: int) -> bool:
        """Return whether it is time, and if so wait for the next time from here on."""
        period = round(NS_PER_S / self.rate_hz)
        if self._next_ns is None:
            self._next_ns = now_ns
        if now_ns < self._next_ns:
            return False
        missed = (now_ns - self._next_ns) // period
        self._next_ns += (missed + 1) * period
        return True

    def wait_s(self, now_ns: int) -> float:
        """Return how long it is until the next time, seconds; 0: it is due."""
        if self._next_ns is None:
            return 0.0
        return max(0.0, (self._next_ns - now_ns) / NS_PER_S)


@dataclass
class RealTime:
    """Simulated time per wall time, and pictures taken per pictures due, over the last second."""

    fps: float
    _steps: deque[tuple[int, float]] = field(default_factory=deque[tuple[int, float]])
    _frames: deque[int] = field(default_factory=deque[int])
    _begin_ns: int | None = None

    def note_frame(self, at_ns: int) -> None:
        """Note that a picture was taken at `at_ns`."""
        self._frames.append(at_ns)

    def factor(self, now_ns: int, simulated_s: float) -> float:
        """Return the smaller of the two ratios, 0..1; 1 until a second has passed.

        Args:
            now_ns: monotonic time.
            simulated_s: time simulated since the start.
        """
        if self._begin_ns is None:
            self._begin_ns = now_ns
        self._steps.append((now_ns, simulated_s))
        while len(self._steps) > 2 and self._steps[1][0] <= now_ns - WINDOW_NS:
            self._steps.popleft()
        while self._frames and self._frames[0] <= now_ns - WINDOW_NS:
            self._frames.popleft()
        if now_ns - self._begin_ns < WINDOW_NS:
            return 1.0
        (first_ns, first_s), wall_s = self._steps[0], 0.0
        wall_s = (now_ns - first_ns) / NS_PER_S
        steps = (simulated_s - first_s) / wall_s if wall_s > 0 else 1.0
        # A whole number of pictures fits the window give or take one.
        frames = (len(self._frames) + 0.5) / self.fps
        return max(0.0, min(1.0, steps, frames))
