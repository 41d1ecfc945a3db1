"""Clocks, ages and staleness: pure, `now` is always an argument.

A time is nanoseconds on some host's monotonic clock, together with that clock's identity: two
monotonic clocks have nothing in common but a measured offset. An age that cannot be known is
`None`, and `is_stale` calls that stale: what might be old never moves a robot.
"""

from dataclasses import dataclass, field
from typing import Protocol

NS_PER_S = 1_000_000_000
MAX_COMMAND_AGE_S = 0.2
"""Issued to vehicle; older velocity commands are refused everywhere."""


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


@dataclass
class ReplayGate:
    """Lets each (epoch, sequence) of one sender through once, in order.

    A restarted sender has a newer epoch and starts a new sequence; an older epoch, or a sequence
    that is not newer within the same epoch, is a replay.
    """

    _newest: tuple[int, int] = field(default=(-1, -1))

    def accept(self, epoch: int, sequence: int) -> bool:
        """Return whether (epoch, sequence) is newer than all that passed, and remember it."""
        if (epoch, sequence) <= self._newest:
            return False
        self._newest = (epoch, sequence)
        return True
