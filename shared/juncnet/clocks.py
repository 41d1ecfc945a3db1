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
MAX_CLOCKS = 64
"""Whose senders a gate remembers."""


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
    """Lets each thing sent through once, in order, and one host at a time.

    It is against what comes again, late or out of order, and against a predecessor that still
    sends.
    - Of one clock, which is one boot of one host, a newer epoch passes, or the same one with a
      higher sequence. An epoch is the monotonic time at which its process started, so a restarted
      process is heard from its first message on, even if the wall clock has been set back.
    - Of another clock, as after a boot or when a service has moved to another host, something
      passes that was sent later than all that passed, which needs the measured offset, by a
      process that started after those of that clock that were heard.
    It does not judge ages: its users refuse what is stale.
    """

    _clock: str | None = None
    """Of the sender that is heard now."""
    _newest: dict[str, tuple[int, int]] = field(default_factory=dict[str, tuple[int, int]])
    """Epoch and sequence of the newest that passed, by clock; the clock heard last comes last."""
    _sent_ns: int | None = None
    """When the newest was sent, on our clock; None: nothing of known time has passed."""

    def accept(self, stamp: Stamped, now: Instant, offset: Offset | None = None) -> bool:
        """Return whether `stamp` is newer than all that passed, and remember it then.

        `offset`: of the stamp's clock against that of `now`, where it is another and known.
        """
        sent = stamp.instant
        known = age_s(sent, now, offset) is not None
        sent_ns = local_ns(sent, now, offset) if known else None
        newest = self._newest.get(sent.clock, (-1, -1))
        if self._clock in (None, sent.clock):
            newer = (stamp.epoch, stamp.sequence) > newest
        else:
            newer = stamp.epoch > newest[0] and self._is_later(sent_ns)
        if not newer:
            return False
        self._newest.pop(sent.clock, None)
        if len(self._newest) >= MAX_CLOCKS:
            del self._newest[next(iter(self._newest))]
        self._newest[sent.clock] = stamp.epoch, stamp.sequence
        self._clock = sent.clock
        self._sent_ns = self._sent_ns if sent_ns is None else sent_ns
        return True

    def _is_later(self, sent_ns: int | None) -> bool:
        return sent_ns is not None and (self._sent_ns is None or sent_ns > self._sent_ns)
