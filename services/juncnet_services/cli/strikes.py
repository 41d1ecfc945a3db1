"""Kills processes of a flight at random moments, and measures what the vehicle was told then."""

import os
import random
import signal
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from pydantic import BaseModel, ConfigDict

from juncnet.bus import Bus, Inbox
from juncnet.clocks import NS_PER_S
from juncnet.flight import Flight
from juncnet.launch import connect
from juncnet.messages import NavigationState, Output, OverrideKind, Phase, VehicleState
from juncnet.topics import COMMAND_VELOCITY, NAVIGATION_STATE, SERVICES, VEHICLE_STATE
from juncnet_services.cli.bench.measured import children_of
from juncnet_services.cli.link_tap import LinkTap, Told
from juncnet_services.cli.operator import order
from juncnet_services.cli.supervise import Supervisor

GUARD = "guard"
VICTIMS = (*SERVICES, GUARD)
MOVING_MPS, MOVING_RADPS = 0.3, 0.1
AFTER_STOP_S = 1.0
"""How long the robot may be stopped for good before the soak resumes it, as an operator would."""


class Strike(BaseModel):
    """A process killed in mid-flight, and what followed; None: it did not happen."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int
    """Of the world."""
    process: str
    phase: Phase
    """Of the navigation, at the kill."""
    count: int
    """Junctions counted, at the kill."""
    hold_s: float | None
    """From the kill to the first hold (brake) at the vehicle, before it moved again."""
    still_s: float | None
    """From the kill to where the pipeline began to slow the vehicle down to rest, if it did so
    before any hold: the navigator stops when it misses score or road."""
    since_command_s: float | None
    """From the issue of the last velocity command before that hold to the hold."""
    silence_s: float
    """Longest time between two setpoints at the vehicle until it was commanded again."""
    commanded_s: float | None
    """From when the vehicle was told to rest to when it was told to move again."""


@dataclass(frozen=True)
class Kill:
    """When and in which state of the mission a process was killed."""

    ns: int
    process: str
    phase: Phase
    count: int


def strike(
    seed: int, kill: Kill, until_ns: int, told: Sequence[Told], issued_ns: Sequence[int]
) -> Strike:
    """Return what followed `kill` up to `until_ns`.

    `told` are the setpoints at the vehicle, `issued_ns` the times at which velocity commands were
    issued, both of the whole flight and ascending, on the monotonic clock of this host.
    """
    after = [t for t in told if kill.ns <= t.ns < until_ns]
    rest = next((t for t in after if not is_moving(t)), None)
    again = next((t for t in after if rest and t.ns > rest.ns and is_moving(t)), None)
    hold = next((t for t in after if t.holds and (again is None or t.ns < again.ns)), None)
    last_command = max((ns for ns in issued_ns if hold and ns <= hold.ns), default=None)
    last_before = max((t.ns for t in told if t.ns < kill.ns), default=kill.ns)
    times = [last_before, *(t.ns for t in after if again is None or t.ns <= again.ns)]
    gaps = [b - a for a, b in pairwise(times)]
    return Strike(
        seed=seed,
        process=kill.process,
        phase=kill.phase,
        count=kill.count,
        hold_s=_s(hold and hold.ns - kill.ns),
        since_command_s=_s(hold and last_command and hold.ns - last_command),
        still_s=_s(None if rest is None or rest.holds else slowing_ns(after, rest) - kill.ns),
        silence_s=max(gaps, default=until_ns - last_before) / NS_PER_S,
        commanded_s=_s(rest and again and again.ns - rest.ns),
    )


def slowing_ns(told: Sequence[Told], rest: Told) -> int:
    """Return when the unbroken row of ever slower setpoints began that ends with `rest`."""
    began = rest
    for earlier in reversed([t for t in told if t.ns < rest.ns]):
        if earlier.setpoint.forward_mps <= began.setpoint.forward_mps:
            break
        began = earlier
    return began.ns


def _s(ns: int | None) -> float | None:
    return None if ns is None else ns / NS_PER_S


def is_moving(told: Told) -> bool:
    """Return whether a setpoint makes the vehicle move."""
    setpoint = told.setpoint
    turning = abs(setpoint.yaw_rate_radps) > MOVING_RADPS
    return not told.holds and (abs(setpoint.forward_mps) > MOVING_MPS or turning)


class Striker:
    """Kills the processes of one flight in turn, in a thread of its own; a context.

    Args:
        flight: the flight.
        victims: whom to kill, in this order, over and over; empty: nobody, it only listens.
        period_s: between two kills, on average; only a robot that is commanded to move is struck.
        chance: says when.
    """

    def __init__(
        self, flight: Flight, victims: Sequence[str], period_s: float, chance: random.Random
    ) -> None:
        self._flight, self._victims = flight, victims
        self._period_s, self._chance = period_s, chance
        self._supervisor = Supervisor(flight.directory)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.kills: list[Kill] = []
        self.told: list[Told] = []
        self.issued_ns: list[int] = []
        self.resumed = 0
        """How often the robot had stopped for good and was resumed as by an operator."""
        self.failure: Exception | None = None
        """What ended the thread early."""

    def __enter__(self) -> "Striker":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def strikes(self, seed: int) -> list[Strike]:
        """Return what followed each kill, up to the next one or the end."""
        ends = [kill.ns for kill in self.kills[1:]]
        last = max((t.ns for t in self.told), default=0) + 1
        return [
            strike(seed, kill, until, self.told, self.issued_ns)
            for kill, until in zip(self.kills, [*ends, last], strict=False)
        ]

    def _run(self) -> None:
        try:
            with connect(self._flight.directory, timeout_s=60) as bus:
                vehicles = bus.subscribe(VEHICLE_STATE, 100)
                with self._tap(vehicles) as tap:
                    self.told = tap.told
                    self._strike_on(bus, vehicles)
        except Exception as error:
            self.failure = error

    def _tap(self, vehicles: Inbox[VehicleState]) -> LinkTap:
        while not self._ended.is_set():
            state = vehicles.take(0.2)
            if state is not None and state.pose is not None:  # the link works in both directions
                break
        return LinkTap(self._flight.directory)

    def _strike_on(self, bus: Bus, vehicles: Inbox[VehicleState]) -> None:
        states = bus.subscribe(NAVIGATION_STATE)
        commands = bus.subscribe(COMMAND_VELOCITY, 1000)
        next_s, stopped_s = time.monotonic() + self._wait_s(), float("inf")
        while not self._ended.is_set():
            bus.wait(0.05)
            states.drain()
            self.issued_ns += [command.issued.time_ns for _, command in commands.drain()]
            for _, vehicle in vehicles.drain():
                stopped = vehicle.output is Output.STOPPED
                stopped_s = min(stopped_s, time.monotonic()) if stopped else float("inf")
            if time.monotonic() > stopped_s + AFTER_STOP_S:
                self.resumed += 1
                order(bus, OverrideKind.RESUME, "soak", 2.0)
                stopped_s = float("inf")
            if self._victims and time.monotonic() > next_s and self._kill(states.newest):
                next_s = time.monotonic() + self._wait_s()

    def _wait_s(self) -> float:
        return self._period_s * self._chance.uniform(0.5, 1.5)

    def _kill(self, state: NavigationState | None) -> bool:
        """Kill the next victim, and return whether it was; not unless the robot moves."""
        if state is None or not self.told or not is_moving(self.told[-1]):
            return False
        process = self._victims[len(self.kills) % len(self._victims)]
        pid = self._pid(process)
        if not pid:
            return False
        kill = Kill(time.monotonic_ns(), process, state.phase, state.count)
        os.kill(pid, signal.SIGKILL)
        self.kills.append(kill)
        return True

    def _pid(self, process: str) -> int | None:
        pids = {status.name: status.pid for status in self._supervisor.status()}
        if process != GUARD:
            return pids.get(process)
        children = children_of(pids.get("command_output", 0))
        return children[0] if children else None
