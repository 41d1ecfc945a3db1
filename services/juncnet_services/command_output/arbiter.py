"""Who is obeyed: pure. Emergency > stop, landing, taking off > manual > pipeline > hold.

Once somebody flies by hand the pipeline moves nothing until an operator resumes: a pilot who falls
silent stops the robot.

An accepted velocity lives until the earliest of: `command_life_s` after its acceptance,
`MAX_COMMAND_AGE_S` after it was issued, `picture_age_s` after its picture was captured. Then the
robot holds. `command_life_s` is 0.15 s, so that 50 ms of the 0.2 s remain for the tick of the loop
(10 ms), for a busy machine, and for the guard process behind it (`GUARD_MARGIN_S`).
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import (
    MAX_COMMAND_AGE_S,
    NS_PER_S,
    Instant,
    Offset,
    ReplayGate,
    age_s,
    is_stale,
)
from juncnet.messages import Output, Override, OverrideKind, Stamp, Velocity, VelocityCommand

GUARD_MARGIN_S = 0.02
"""How long after the end of a command's life the guard holds, should this process not have."""
MAX_ORDER_AGE_S = 2.0
"""Orders other than hold that are known to be older than this are refused."""
MAX_OPERATORS = 64
"""Whose orders are told from repeats: processes of operators, each with orders of its own."""
AGE_UNKNOWN = "order_age_unknown"
"""In the refusal of an order from a clock whose offset is not known (yet)."""
TAKE_OFF_S = 5.0
"""How long an accepted take-off is the output; stopped afterwards, in the air."""


class Rules(BaseModel):
    """What is obeyed, and for how long."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    picture_age_s: float = Field(default=0.2, gt=0, le=5)
    """Oldest picture (captured to vehicle) that may move the robot: 0.2 local, 0.6 over WiFi."""
    command_life_s: float = Field(default=0.15, gt=0, le=0.15)
    """How long an accepted velocity is obeyed before the robot holds."""
    loss_latch_s: float = Field(default=5.0, gt=0, le=60)
    """A loss of commands longer than this is ended by an operator only."""


class LatchKind(StrEnum):
    """Why the robot is stopped until an operator resumes."""

    HOLD = "hold"
    LAND = "land"
    EMERGENCY = "emergency"
    LOSS = "loss"
    MANUAL = "manual"
    """Flown by hand: velocities by hand are obeyed, nothing else is."""


class Latched(BaseModel):
    """A stop that lasts until an operator resumes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: LatchKind
    reason: str = Field(max_length=1000)
    since: Instant | None = None
    """When the last order came that stops the robot; None: that is not known, or none came."""


@dataclass(frozen=True)
class Decision:
    """What the vehicle shall do now: `velocity`, before limits, until `ends`."""

    output: Output
    reason: str
    velocity: Velocity = field(default_factory=Velocity)
    ends: Instant | None = None

    @property
    def moving(self) -> bool:
        """Whether `velocity` is obeyed; otherwise the vehicle brakes.

        To be told no motion at all is to be told to hold: a navigator that misses its inputs, or an
        operator who lets go, brings the vehicle to rest by its braking limit.
        """
        obeyed = self.output in (Output.PIPELINE, Output.MANUAL)
        return obeyed and self.velocity != Velocity()


@dataclass(frozen=True)
class Verdict:
    """Whether an operator's order is obeyed, and why or why not."""

    accepted: bool
    reason: str


@dataclass(frozen=True)
class _Alive:
    velocity: Velocity
    ends: Instant


class Arbiter:
    """Decides between operator and pipeline; all times are on the clock of this process.

    `latched`: the stop found on disk. `last_accepted`: when a predecessor in this flight last
    accepted a velocity; None before the first of the flight, when nothing can be lost yet.
    `offsets`: measured offsets of other hosts' clocks, by clock.
    """

    def __init__(
        self,
        rules: Rules,
        latched: Latched | None = None,
        last_accepted: Instant | None = None,
        offsets: Mapping[str, Offset] | None = None,
    ) -> None:
        self.rules = rules
        self.latched = latched
        self.last_accepted = last_accepted
        self.refused: Counter[str] = Counter()
        self._offsets: Mapping[str, Offset] = {} if offsets is None else offsets
        self._manual: _Alive | None = None
        self._pipeline: _Alive | None = None
        self._gate = ReplayGate()
        self._operators: dict[tuple[str, str, int], int] = {}
        """The highest sequence by operator and process of theirs, the latest heard last."""
        self._cut = False
        self._taking_off: Instant | None = None
        self._stopped = None if latched is None else latched.since
        """When the last order came that stops the robot; a take-off does, for it ends stopped."""

    def command(self, command: VelocityCommand, now: Instant) -> str | None:
        """Take a velocity of the pipeline; return why it is refused, None when it is accepted."""
        issued, picture = self._age(command.issued, now), self._age(command.header, now)
        reason = (
            _stale("command", issued, MAX_COMMAND_AGE_S)
            or _stale("picture", picture, self.rules.picture_age_s)
            or self._replay(command.issued, now)
        )
        if reason is not None or issued is None or picture is None:
            reason = reason or "command_age_unknown"
            self.refused[reason] += 1
            return reason
        left_s = min(MAX_COMMAND_AGE_S - issued, self.rules.picture_age_s - picture)
        self._pipeline = self._accept(command.velocity, now, left_s)
        return None

    def override(self, order: Override, now: Instant, trouble: str = "") -> Verdict:
        """Take an operator's order; return whether it is obeyed.

        `trouble`: why the vehicle will not fly, if so: it refuses a take-off, and nothing else.

        A hold is obeyed whatever its age, clock or sequence: to stop once too often is safe. All
        others are refused when repeated; each process of an operator numbers its own orders, so two
        terminals do not refuse each other's. Resume, manual and take-off need a known, fresh age;
        land and emergency are refused only when known to be old.
        A resume or take-off that was first given before the last stop is refused, however often it
        is given again. A manual velocity is refused while the robot is stopped: stop wins, so the
        operator resumes first. A take-off is refused while anything moves the robot, and leaves it
        stopped: in the air, until an operator resumes. Ordered again while it is the output, it
        changes nothing.
        """
        match order.kind:
            case OverrideKind.HOLD:
                self._newer(order)
                self._stopped = now
                self._latch(LatchKind.HOLD, f"held by {order.operator}")
                return Verdict(True, "holding until resumed")
            case OverrideKind.LAND | OverrideKind.EMERGENCY:
                return self._end_flight(order, now)
            case OverrideKind.RESUME:
                return self._resume(order, now)
            case OverrideKind.MANUAL:
                return self._fly_manually(order, now)
            case OverrideKind.TAKE_OFF:
                return self._take_off(order, now, trouble)

    def step(self, now: Instant) -> Decision:
        """Return what the vehicle shall do at `now`; latches a loss that has lasted too long."""
        self._manual = _living(self._manual, now)
        self._pipeline = _living(self._pipeline, now)
        free = self.latched is None or self.latched.kind is LatchKind.MANUAL
        if free and self._loss_s(now) > self.rules.loss_latch_s:
            reason = f"no command accepted for {self.rules.loss_latch_s:g} s: an operator resumes"
            self._latch(LatchKind.LOSS, reason)
        if self._cut:
            return Decision(Output.EMERGENCY, "motors cut by an operator")
        if self._takes_off(now):
            return Decision(Output.TAKING_OFF, "taking off")
        if self._manual is not None:
            return Decision(Output.MANUAL, "manual", self._manual.velocity, self._manual.ends)
        if self.latched is not None:
            landing = self.latched.kind is LatchKind.LAND
            return Decision(Output.LANDING if landing else Output.STOPPED, self.latched.reason)
        if self._pipeline is not None:
            return Decision(Output.PIPELINE, "", self._pipeline.velocity, self._pipeline.ends)
        waiting = "no command yet" if self.last_accepted is None else "no fresh command"
        return Decision(Output.HOLD, waiting)

    def _end_flight(self, order: Override, now: Instant) -> Verdict:
        age = self._age(order.issued, now)
        if age is not None and age > MAX_ORDER_AGE_S:
            return Verdict(False, f"{order.kind} is {age:.1f} s old, at most {MAX_ORDER_AGE_S:g}")
        if not self._newer(order):
            return Verdict(False, f"{order.kind} is a repeat, or older than another of its sender")
        self._stopped = now
        if order.kind is OverrideKind.LAND:
            self._latch(LatchKind.LAND, f"landing for {order.operator}")
            return Verdict(True, "landing; stopped until resumed")
        self._cut = True
        self._latch(LatchKind.EMERGENCY, f"motors cut by {order.operator}")
        return Verdict(True, "motors cut; stopped until resumed")

    def _resume(self, order: Override, now: Instant) -> Verdict:
        refusal = self._refusal(order, now, MAX_ORDER_AGE_S) or self._overtaken(order, now)
        if refusal is not None:
            return refusal
        was = "was not stopped" if self.latched is None else f"was: {self.latched.reason}"
        self.latched, self._cut, self._taking_off = None, False, None
        self._manual = self._pipeline = None
        if self.last_accepted is not None:
            self.last_accepted = now
        return Verdict(True, f"obeying commands again ({was})")

    def _take_off(self, order: Override, now: Instant, trouble: str) -> Verdict:
        refusal = self._refusal(order, now, MAX_ORDER_AGE_S)
        if refusal is None and self._takes_off(now):
            return Verdict(True, "is taking off already; stopped until resumed")
        refusal = refusal or self._overtaken(order, now)
        if refusal is not None:
            return refusal
        if trouble:
            return Verdict(False, f"no take-off: {trouble}")
        if self.latched is not None and self.latched.kind is LatchKind.EMERGENCY:
            return Verdict(False, "no take-off: the motors are cut, resume first")
        if self.step(now).moving:
            return Verdict(False, "no take-off: the robot is being moved, stop it first")
        self._stopped = now
        self._latch(LatchKind.HOLD, f"took off for {order.operator}, resume to go on")
        self._taking_off = Instant(now.ns + int(TAKE_OFF_S * NS_PER_S), now.clock)
        return Verdict(True, "taking off; stopped until resumed")

    def _takes_off(self, now: Instant) -> bool:
        return self._taking_off is not None and now.ns < self._taking_off.ns

    def _fly_manually(self, order: Override, now: Instant) -> Verdict:
        refusal = self._refusal(order, now, MAX_COMMAND_AGE_S)
        if refusal is not None:
            return refusal
        stopped = self.latched is not None and self.latched.kind is not LatchKind.MANUAL
        if stopped or self._loss_s(now) > self.rules.loss_latch_s:
            return Verdict(False, "stopped: resume first")
        age = self._age(order.issued, now)
        if order.velocity is None or age is None:
            return Verdict(False, "there is no velocity, or its age is unknown")
        if self.latched is None:
            reason = f"flown by hand by {order.operator}, resume to go on"
            self._latch(LatchKind.MANUAL, reason)
        self._manual = self._accept(order.velocity, now, MAX_COMMAND_AGE_S - age)
        return Verdict(True, "manual")

    def _refusal(self, order: Override, now: Instant, limit_s: float) -> Verdict | None:
        reason = _stale("order", self._age(order.issued, now), limit_s)
        if reason is None and not self._newer(order):
            reason = "a repeat, or older than another of its sender"
        return None if reason is None else Verdict(False, f"{order.kind} refused: {reason}")

    def _overtaken(self, order: Override, now: Instant) -> Verdict | None:
        """Return a refusal of an order that was first given before the last one that stops."""
        age = self._age(order.first_issued or order.issued, now)
        stopped = None if self._stopped is None else age_s(self._stopped, now)
        if stopped is None or (age is not None and age <= stopped):
            return None
        return Verdict(False, f"{order.kind} refused: it was stopped since: give it again")

    def _accept(self, velocity: Velocity, now: Instant, left_s: float) -> _Alive:
        if self._loss_s(now) <= self.rules.loss_latch_s:
            self.last_accepted = now
        life_ns = int(min(self.rules.command_life_s, left_s) * NS_PER_S)
        return _Alive(velocity, Instant(now.ns + life_ns, now.clock))

    def _loss_s(self, now: Instant) -> float:
        """Seconds since the last acceptance, infinite when they cannot be known."""
        if self.last_accepted is None:
            return 0.0
        age = age_s(self.last_accepted, now)
        return float("inf") if age is None else age

    def _age(self, stamp: Stamp, now: Instant) -> float | None:
        return age_s(stamp.instant, now, self._offsets.get(stamp.clock))

    def _newer(self, order: Override) -> bool:
        """Whether `order` is newer than all of its sender before; remembers it."""
        issued = order.issued
        sender = (order.operator, issued.clock, issued.epoch)
        newest = self._operators.pop(sender, -1)
        if len(self._operators) >= MAX_OPERATORS:
            del self._operators[next(iter(self._operators))]
        self._operators[sender] = max(newest, issued.sequence)
        return issued.sequence > newest

    def _replay(self, issued: Stamp, now: Instant) -> str | None:
        offset = self._offsets.get(issued.clock)
        return None if self._gate.accept(issued, now, offset) else "command_replayed"

    def _latch(self, kind: LatchKind, reason: str) -> None:
        """Stop until an operator resumes; that the motors were cut is not forgotten before."""
        if self.latched is not None and self.latched.kind is LatchKind.EMERGENCY:
            kind, reason = self.latched.kind, self.latched.reason
        self.latched = Latched(kind=kind, reason=reason, since=self._stopped)
        self._manual = self._pipeline = self._taking_off = None


def _stale(what: str, age: float | None, limit_s: float) -> str | None:
    """Return why something of this age is refused, as a counter's name; None: it is not."""
    if age is None:
        return f"{what}_age_unknown"
    return f"{what}_stale" if is_stale(age, limit_s) else None


def _living(alive: _Alive | None, now: Instant) -> _Alive | None:
    """Return `alive` while its life lasts; not on a clock that is not its own."""
    if alive is None or alive.ends.clock != now.clock or now.ns >= alive.ends.ns:
        return None
    return alive
