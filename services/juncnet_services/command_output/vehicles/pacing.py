"""Drivers that repeat their setpoint at a steady rate: a thread, a pace, a watchdog.

What is to be sent is the business of a `Core`, pure and without a clock; how it travels is that of
a `Link`. Between them: the newest wish of command_output, which turns into a hold by itself when
it is not renewed in time.
"""

import contextlib
import logging
import os
import select
import threading
import time
from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from typing import Protocol, runtime_checkable

from juncnet.clocks import NS_PER_S
from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import Telemetry

LOG = logging.getLogger(__name__)
RATE_HZ = 20.0
RETRY_S = 1.0
"""Between two attempts to connect."""
MAX_DATAGRAMS = 256
"""Received at a time: setpoints go out in time, however much comes in."""


class LinkGoneError(OSError):
    """The link cannot come back in this process: it ends, and its supervisor starts another."""


class Aim(Enum):
    """What command_output called last."""

    FLY = auto()
    LAND = auto()
    EMERGENCY = auto()


@dataclass(frozen=True)
class Wish:
    """What the vehicle shall do, until `until_ns`; then it holds."""

    aim: Aim = Aim.FLY
    velocity: Velocity = field(default_factory=Velocity)
    brake: bool = True
    until_ns: int = 0

    def at(self, now_ns: int) -> "Wish":
        """Return this wish, as a hold once its time is over; a landing goes on."""
        if self.aim is not Aim.FLY or self.brake or now_ns < self.until_ns:
            return self
        return replace(self, velocity=Velocity(), brake=True)


class Core(Protocol):
    """A driver's protocol and logic; `now_ns` is monotonic."""

    @property
    def trouble(self) -> str:
        """Why the vehicle will not fly; empty when it will."""
        ...

    @property
    def lost(self) -> bool:
        """Whether the link has to be made anew, as of the last `due`."""
        ...

    def connected(self, now_ns: int) -> None:
        """Begin anew: the link has just been made."""
        ...

    def heard(self, datagram: bytes, now_ns: int) -> list[bytes]:
        """Take what the vehicle sent, whatever it is; return what to answer at once."""
        ...

    def due(self, wish: Wish, now_ns: int) -> list[bytes]:
        """Return what to send now; asked at the steady rate, and at once for a hold."""
        ...

    def take_off(self, now_ns: int) -> None:
        """Take off, as far as the state of the vehicle allows."""
        ...

    def ending(self) -> list[bytes]:
        """Return what to send last, several times, when the driver is closed."""
        ...

    def telemetry(self, now_ns: int, max_age_s: float) -> Telemetry | None:
        """Return the newest measurement; None when it is older."""
        ...


@runtime_checkable
class AbortingCore(Protocol):
    """A core that goes on with a take-off by itself, until it is told not to."""

    def abort_take_off(self, now_ns: int) -> None:
        """Go on with a take-off no more, if there is one; see `AbortsTakeOff`."""
        ...


class Link(Protocol):
    """A connected link: non-blocking."""

    def fileno(self) -> int: ...
    def send(self, data: bytes) -> None:
        """Send, or raise `OSError`."""
        ...

    def receive(self) -> bytes | None:
        """Return a datagram, None for a stranger's; `BlockingIOError` when there is none."""
        ...


class PacedVehicle(ABC):
    """The part of a driver that is the same for all that speak at a steady rate."""

    def __init__(self, core: Core, rate_hz: float = RATE_HZ) -> None:
        self.send_failures = 0
        self._core = core
        self._period_ns = int(NS_PER_S / rate_hz)
        self._wish = Wish()
        self._lock = threading.Lock()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._ended = False
        self._link_trouble = "not connected yet"
        self._gone: LinkGoneError | None = None
        self._thread = threading.Thread(target=self._run, name="vehicle", daemon=True)

    @abstractmethod
    def connect(self) -> AbstractContextManager[Link]:
        """Return the link, connected; may take seconds.

        Raises:
            OSError, ValueError: it cannot be made; the text says what to do.
        """

    def start(self) -> None:
        """Begin to connect and to send."""
        self._thread.start()

    @property
    def trouble(self) -> str:
        """Why the vehicle will not fly; empty when it will."""
        with self._lock:
            return self._link_trouble or self._core.trouble

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        if self._gone is not None:
            raise self._gone
        until_ns = time.monotonic_ns() + int(lasts_s * NS_PER_S)
        self._want(Wish(Aim.FLY, velocity, brake, until_ns))

    def take_off(self) -> None:
        with self._lock:
            self._core.take_off(time.monotonic_ns())

    def abort_take_off(self) -> None:
        if isinstance(self._core, AbortingCore):
            with self._lock:
                self._core.abort_take_off(time.monotonic_ns())
            self._poke()

    def land(self) -> None:
        self._want(Wish(Aim.LAND))

    def emergency(self) -> None:
        self._want(Wish(Aim.EMERGENCY))

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        with self._lock:
            return self._core.telemetry(time.monotonic_ns(), max_age_s)

    def finish(self, landing: bool, seconds: float) -> None:
        """Hold or land for `seconds`, then end the thread; for `close`, which may come twice."""
        if self._ended:
            return
        self._want(Wish(Aim.LAND) if landing else Wish())
        if not self._link_trouble:
            time.sleep(seconds)
        self._ended = True
        self._poke()
        self._thread.join(2.0)
        if not self._thread.is_alive():
            os.close(self._wake)

    def _want(self, wish: Wish) -> None:
        """Keep the newest wish; a hold, a landing or an emergency that is new goes out at once."""
        with self._lock:
            before, self._wish = self._wish, wish
        if wish.aim is not before.aim or (wish.brake and not before.brake):
            self._poke()

    def _poke(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.eventfd_write(self._wake, 1)

    def _run(self) -> None:
        while not self._ended:
            try:
                with self.connect() as link:
                    self._say("")
                    with self._lock:
                        self._core.connected(time.monotonic_ns())
                    self._serve(link)
                    if self._ended:
                        self._part(link)
                if not self._ended:
                    self._say("the vehicle has gone silent, connecting anew")
            except LinkGoneError as error:
                self._gone = error
                return
            except (OSError, ValueError) as error:
                self._say(str(error) or type(error).__name__)
            if not self._ended:
                select.select([self._wake], [], [], RETRY_S)
                self._unpoke()

    def _say(self, trouble: str) -> None:
        if trouble and trouble != self._link_trouble:
            LOG.warning("%s", trouble)
        with self._lock:
            self._link_trouble = trouble

    def _serve(self, link: Link) -> None:
        """Receive and send until the link is lost or the driver is closed."""
        due_ns = time.monotonic_ns()
        while not self._ended:
            wait_s = max(0.0, (due_ns - time.monotonic_ns()) / NS_PER_S)
            ready, _, _ = select.select([link, self._wake], [], [], wait_s)
            if link in ready:
                self._receive(link)
            now_ns = time.monotonic_ns()
            if self._wake in ready:
                self._unpoke()
            elif now_ns < due_ns:
                continue
            with self._lock:
                packets = self._core.due(self._wish.at(now_ns), now_ns)
                if self._core.lost:
                    return
            self._send(link, packets)
            # A hold out of turn begins a new period; a late one does not shift the next.
            late = now_ns - due_ns
            due_ns = (due_ns if 0 <= late < self._period_ns else now_ns) + self._period_ns

    def _part(self, link: Link) -> None:
        for _ in range(3):
            with self._lock:
                packets = self._core.ending()
            self._send(link, packets)
            if packets:
                time.sleep(0.05)

    def _receive(self, link: Link) -> None:
        for _ in range(MAX_DATAGRAMS):
            try:
                datagram = link.receive()
            except ConnectionRefusedError:
                continue  # nobody listens there at this moment; whether it is lost, the core says
            except BlockingIOError:
                return
            if datagram is not None:
                with self._lock:
                    answers = self._core.heard(datagram, time.monotonic_ns())
                self._send(link, answers)

    def _send(self, link: Link, packets: list[bytes]) -> None:
        for packet in packets:
            try:
                link.send(packet)
            except OSError:
                self.send_failures += 1

    def _unpoke(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._wake)
