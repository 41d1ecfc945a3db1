"""What a process tells about itself: counted here, published once a second by the bus."""

import logging
import math
import threading
from collections.abc import Sequence
from typing import Protocol

from juncnet.clock_offset import Offsets
from juncnet.clocks import NS_PER_S, Clock, Instant, Offset, age_s
from juncnet.messages import Health, RemoteClock, Stamp

LOG_EVERY_NS = NS_PER_S
"""At most one line in this time for survived errors, however many there are."""


def percentile(ordered: Sequence[float], fraction: float) -> float:
    """Return the value at `fraction` (0..1) of an ascending, non-empty sequence: nearest rank."""
    return ordered[max(0, math.ceil(fraction * len(ordered)) - 1)]


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


class HealthCounters:
    """A `HealthReport` that any thread may write to; `report` closes the window."""

    def __init__(self, service: str, clock: Clock, offsets: Offsets | None = None) -> None:
        self._service, self._clock = service, clock
        self._offsets = Offsets(clock) if offsets is None else offsets
        self._linked: bool | None = None
        self._log = logging.getLogger(service)
        self._lock = threading.RLock()
        self._errors = 0
        self._last_error = ""
        self._logged_ns, self._unlogged = -LOG_EVERY_NS, 0
        self._counters: dict[str, float] = {}
        self._window_ns = clock.now_ns()
        self._outputs = 0
        self._latencies_ms: list[float] = []
        self._ages_s: list[float] = []

    def error(self, text: str) -> None:
        """Count a failure that was survived, log it (rate-limited) and show it as `last_error`."""
        text = text.encode("utf-8", "replace").decode()  # a file's name may hold what is no text
        with self._lock:
            self._errors += 1
            self._last_error = text
            now_ns = self._clock.now_ns()
            if now_ns - self._logged_ns < LOG_EVERY_NS:
                self._unlogged += 1
                return
            more = f" (and {self._unlogged} more errors)" if self._unlogged else ""
            self._logged_ns, self._unlogged = now_ns, 0
        self._log.warning("%s%s", text, more)

    def set(self, counter: str, value: float) -> None:
        """Set one of the service's own counters."""
        with self._lock:
            self._counters[counter] = float(value)

    def add(self, counter: str, value: float = 1.0) -> None:
        """Add to one of the service's own counters."""
        with self._lock:
            self._counters[counter] = self._counters.get(counter, 0.0) + value

    def output(self, taken_ns: int, header: Stamp | None) -> None:
        """Note that a main output was published for what was taken at `taken_ns`."""
        now_ns = self._clock.now_ns()
        age = None
        if header is not None:
            offset = self._offsets.get(header.clock)
            age = age_s(header.instant, Instant(now_ns, self._clock.id), offset)
        with self._lock:
            self._outputs += 1
            self._latencies_ms.append(max(0, now_ns - taken_ns) / 1e6)
            if age is not None:
                self._ages_s.append(age)

    def linked(self, linked: bool | None) -> None:
        """Note whether the vehicle's router is reached; None: this host needs no link to it."""
        self._linked = linked

    def report(self, at: Stamp, flight: str, pid: int, drops: int) -> Health:
        """Return the health of the time since the last report, and begin a new window."""
        with self._lock:
            now_ns = self._clock.now_ns()
            seconds = max(1e-3, (now_ns - self._window_ns) / NS_PER_S)
            latencies = sorted(self._latencies_ms)
            health = Health(
                service=self._service,
                at=at,
                flight=flight,
                pid=pid,
                rate_hz=self._outputs / seconds,
                age_s=max(self._ages_s, default=None),
                drops=drops,
                errors=self._errors,
                latency_p50_ms=percentile(latencies, 0.5) if latencies else None,
                latency_p99_ms=percentile(latencies, 0.99) if latencies else None,
                last_error=self._last_error,
                counters=dict(self._counters),
                linked=self._linked,
                clocks={clock: _told(o) for clock, o in self._offsets.wanted().items()},
            )
            self._window_ns, self._outputs = now_ns, 0
            self._latencies_ms.clear()
            self._ages_s.clear()
        return health


def _told(offset: Offset | None) -> RemoteClock:
    if offset is None:
        return RemoteClock()
    return RemoteClock(offset_ns=offset.offset_ns, uncertainty_ns=offset.uncertainty_ns)
