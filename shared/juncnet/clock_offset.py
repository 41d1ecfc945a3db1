"""How far the clocks of other hosts run ahead of ours: measured, bounded, forgotten when old. Pure.

A question leaves at `asked_ns` and its answer is back at `answered_ns`, both on our clock; the
other clock showed `remote_ns` some time between. So the offset lies between `remote_ns -
answered_ns` and `remote_ns - asked_ns`, whatever the link did: a bound, not a guess. Bounds of
several exchanges are intersected, each widened by what the clocks may have drifted since. One quick
way there and one quick way back are enough, also of different exchanges, while a loaded link delays
all others.
"""

import threading
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from juncnet.clocks import NS_PER_S, Clock, Offset

DRIFT = 200e-6
"""How fast two clocks may drift apart at most: two crystals of 100 ppm."""
WINDOW_S = 10.0
"""Exchanges older than this count no more; with none left the offset is unknown."""
EXCHANGES_KEPT = 64
PERIOD_S = 1.0
"""Between questions about a clock whose offset is known."""
FIRST_PERIOD_S = 0.1
"""Between questions about a clock until its offset is known."""
WANTED_S = 30.0
"""A clock that nobody asked about for so long is measured no more."""
MAX_CLOCKS = 16
"""Clocks that are measured at most: whoever invents identities must not grow this table."""


@dataclass(frozen=True)
class Exchange:
    """A question about a remote clock and its answer; times in ns, `remote_ns` on that clock."""

    asked_ns: int
    remote_ns: int
    answered_ns: int

    @property
    def least_ns(self) -> int:
        """The offset is at least this: the answer took no time."""
        return self.remote_ns - self.answered_ns

    @property
    def most_ns(self) -> int:
        """The offset is at most this: the question took no time."""
        return self.remote_ns - self.asked_ns

    @property
    def sound(self) -> bool:
        """Whether the answer came after the question."""
        return self.answered_ns >= self.asked_ns


class OffsetEstimate:
    """The offset of one remote clock, from the exchanges of the last `WINDOW_S`."""

    def __init__(self) -> None:
        self._exchanges: deque[Exchange] = deque(maxlen=EXCHANGES_KEPT)

    def add(self, exchange: Exchange) -> None:
        """Take an exchange; one that contradicts those before it replaces them.

        Clocks jump: a host was suspended, or its clock is being corrected faster than `DRIFT`.
        """
        if not exchange.sound:
            return
        self._exchanges.append(exchange)
        least, most = self._bounds(exchange.answered_ns)
        if least > most:
            self._exchanges.clear()
            self._exchanges.append(exchange)

    def at(self, now_ns: int) -> Offset | None:
        """Return the offset at `now_ns` on our clock; None: not measured, or too long ago."""
        oldest_ns = now_ns - round(WINDOW_S * NS_PER_S)
        while self._exchanges and self._exchanges[0].answered_ns < oldest_ns:
            self._exchanges.popleft()
        if not self._exchanges:
            return None
        least, most = self._bounds(now_ns)
        return Offset((least + most) // 2, (most - least + 1) // 2)

    def _bounds(self, now_ns: int) -> tuple[int, int]:
        """Return the (least, most) offset, in ns, that all exchanges allow at `now_ns`."""
        drifts = [round(DRIFT * max(0, now_ns - e.asked_ns)) for e in self._exchanges]
        pairs = list(zip(self._exchanges, drifts, strict=True))
        return max(e.least_ns - d for e, d in pairs), min(e.most_ns + d for e, d in pairs)


@dataclass
class _Watched:
    estimate: OffsetEstimate = field(default_factory=OffsetEstimate)
    wanted_ns: int = 0
    asked_ns: int = -(1 << 62)


class Offsets(Mapping[str, Offset]):
    """Offsets of other hosts' clocks, by clock, as of now; safe to use from any thread.

    To look a clock up is to want it measured: whoever owns this asks about the clocks that are
    `due` and tells what it `heard`. An unknown offset is no entry.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._watched: dict[str, _Watched] = {}
        self._lock = threading.Lock()

    def __getitem__(self, clock: str) -> Offset:
        now_ns = self._clock.now_ns()
        if clock == self._clock.id:
            return Offset(0, 0)
        with self._lock:
            watched = self._watched.get(clock)
            if watched is None:
                watched = self._watch(clock)
            watched.wanted_ns = now_ns
            offset = watched.estimate.at(now_ns)
        if offset is None:
            raise KeyError(clock)
        return offset

    def __iter__(self) -> Iterator[str]:
        now_ns = self._clock.now_ns()
        with self._lock:
            known = [c for c, w in self._watched.items() if w.estimate.at(now_ns) is not None]
        return iter(known)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def due(self) -> list[str]:
        """Return the clocks to ask about now, and take them as asked."""
        now_ns = self._clock.now_ns()
        due: list[str] = []
        with self._lock:
            for clock, watched in list(self._watched.items()):
                if now_ns - watched.wanted_ns > WANTED_S * NS_PER_S:
                    del self._watched[clock]
                    continue
                known = watched.estimate.at(now_ns) is not None
                period_s = PERIOD_S if known else FIRST_PERIOD_S
                if now_ns - watched.asked_ns >= period_s * NS_PER_S:
                    watched.asked_ns = now_ns
                    due.append(clock)
        return due

    def heard(self, clock: str, exchange: Exchange) -> None:
        """Take an answer about `clock`; of one that nobody wants it is ignored."""
        with self._lock:
            if clock in self._watched:
                self._watched[clock].estimate.add(exchange)

    def wanted(self) -> dict[str, Offset | None]:
        """Return every clock that is wanted, with its offset where that is known."""
        now_ns = self._clock.now_ns()
        with self._lock:
            return {clock: w.estimate.at(now_ns) for clock, w in self._watched.items()}

    def _watch(self, clock: str) -> _Watched:
        if len(self._watched) >= MAX_CLOCKS:
            del self._watched[min(self._watched, key=lambda c: self._watched[c].wanted_ns)]
        self._watched[clock] = _Watched()
        return self._watched[clock]
