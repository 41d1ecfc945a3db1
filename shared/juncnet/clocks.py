"""Clocks, ages and staleness: pure, `now` is always an argument.

A time is nanoseconds on some host's monotonic clock, together with that clock's identity: two
monotonic clocks have nothing in common but a measured offset. An age that cannot be known is
`None`, and `is_stale` calls that stale: what might be old never moves a robot.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

NS_PER_S = 1_000_000_000
MAX_COMMAND_AGE_S = 0.2
"""Issued to vehicle; older velocity commands are refused everywhere."""
FORMER_SENDERS = 64
"""Whom a gate remembers; what those before them sent is older than all that passed."""


class Clock(Protocol):
    """Where a process reads the time; tests bring their own."""

    @property
    def id(self) -> str:
        """Identity of the clock: the same for all processes of one boot of one host."""
        ...

    def now_ns(self) -> int:
        """Monotonic nanoseconds on this clock."""
        ...


@dataclass(frozen=True)
class Instant:
    """A point in time on a named clock, known to within `uncertainty_ns`."""

    ns: int
    clock: str
    uncertainty_ns: int = 0


@dataclass(frozen=True)
class Offset:
    """How far a remote clock runs ahead of ours: `remote_ns - local_ns`, +- `uncertainty_ns`."""

    offset_ns: int
    uncertainty_ns: int


def age_s(then: Instant, now: Instant, offset: Offset | None = None) -> float | None:
    """Return the largest age in seconds that `then` may have at `now`; None: it cannot be known.

    Times of one clock need no offset. Times of two clocks need the measured `offset` of the clock
    of `then` against that of `now`; without one the age is unknown. All uncertainties are added, so
    the result errs towards old. A time in the future beyond its uncertainty has no age: None.
    """
    uncertainty_ns = then.uncertainty_ns + now.uncertainty_ns
    then_ns = then.ns
    if then.clock != now.clock:
        if offset is None:
            return None
        then_ns -= offset.offset_ns
        uncertainty_ns += offset.uncertainty_ns
    age_ns = now.ns - then_ns + uncertainty_ns
    return age_ns / NS_PER_S if age_ns >= 0 else None


def local_ns(then: Instant, now: Instant, offset: Offset | None = None) -> int | None:
    """Return `then` on the clock of `now`; None where the offset of its clock is not known."""
    if then.clock == now.clock:
        return then.ns
    return None if offset is None else then.ns - offset.offset_ns


def is_stale(age: float | None, limit_s: float) -> bool:
    """Return whether something of this `age` (seconds; None: unknown) must not be used any more."""
    return age is None or age > limit_s


class Stamped(Protocol):
    """What tells who sent something, as which in a row, and when."""

    @property
    def epoch(self) -> int: ...
    @property
    def sequence(self) -> int: ...
    @property
    def instant(self) -> Instant: ...


@dataclass
class ReplayGate:
    """Lets each thing sent through once, in order, and one sender at a time.

    It is against what comes again, late or out of order, and against a predecessor that still
    sends. A sender is a process: a clock and an epoch. The epoch names it and orders nothing, for
    it comes from the wall clock, which is set back (NTP, a robot without a battery for it), and
    whoever starts then has the lower epoch. Monotonic time orders: it is not set, is the same for
    all processes of a host, is measured between hosts, and stands in every stamp already, so that
    nothing has to be kept on disk.
    - Of the same sender, only a higher sequence passes.
    - Another sender takes over with something that was sent later than all that passed. So a
      restarted process is heard from its first message on, and nothing that its predecessor sent
      passes, seen before or not. What was sent at an unknown time never takes over.
    - Who was taken over from stays out, however late it sends.
    It does not judge ages: its users refuse what is stale, as after a boot, when clocks are others.
    """

    _sender: tuple[str, int] | None = None
    _sequence: int = -1
    _sent_ns: int | None = None
    """When the newest was sent, on our clock; None: nothing of known time has passed."""
    _former: deque[tuple[str, int]] = field(
        default_factory=lambda: deque[tuple[str, int]](maxlen=FORMER_SENDERS)
    )

    def accept(self, stamp: Stamped, now: Instant, offset: Offset | None = None) -> bool:
        """Return whether `stamp` is newer than all that passed, and remember it then.

        `offset`: of the stamp's clock against that of `now`, where it is another and known.
        """
        sent = stamp.instant
        sender = (sent.clock, stamp.epoch)
        known = age_s(sent, now, offset) is not None
        sent_ns = local_ns(sent, now, offset) if known else None
        if sender == self._sender:
            if stamp.sequence <= self._sequence:
                return False
        elif self._sender is not None:
            if sender in self._former or not self._is_later(sent_ns):
                return False
            self._former.append(self._sender)
        self._sender, self._sequence = sender, stamp.sequence
        self._sent_ns = self._sent_ns if sent_ns is None else sent_ns
        return True

    def _is_later(self, sent_ns: int | None) -> bool:
        return sent_ns is not None and (self._sent_ns is None or sent_ns > self._sent_ns)
