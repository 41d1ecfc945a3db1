"""The flying body: integrates its dynamics in real time and speaks the vehicle link.

A thread of its own keeps it flying and answering while pictures are rendered.
"""

import math
import socket
import threading
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from select import select

from juncnet.clocks import NS_PER_S
from juncnet.messages import Velocity
from juncnet.simulation import link
from juncnet.simulation.dynamics import Motion, Vehicle
from juncnet.simulation.world import wrap

STEP_NS = NS_PER_S // 100
LONGEST_JUMP_NS = NS_PER_S // 2
"""Time that is caught up with; what a stall takes beyond it is lost to the simulation."""
BATTERY_S = 1500.0
FLYING_M = 0.05


class Drone:
    """A vehicle in the simulated world, its newest setpoint and those who listen to it."""

    def __init__(
        self, vehicle: Vehicle, start: Motion, link_loss_s: float, now_ns: int, airborne: bool
    ) -> None:
        self._errors: deque[str] = deque(maxlen=100)
        self._vehicle, self._motion = vehicle, start
        self._airborne = airborne
        self._link_loss_ns = round(link_loss_s * NS_PER_S)
        self._at_ns, self._simulated_ns = now_ns, 0
        self._setpoint, self._heard_ns = link.HOLD, now_ns
        self._listeners: dict[str, int] = {}
        self._telemetry_ns = 0
        self._lock = threading.Lock()

    @property
    def simulated_s(self) -> float:
        """Time simulated since the start."""
        return self._simulated_ns / NS_PER_S

    def at(self, now_ns: int) -> Motion:
        """Return the motion at `now_ns`, monotonic, not before the last call's."""
        with self._lock:
            self._integrate(now_ns)
            return self._motion

    def hear(self, datagram: bytes, sender: str | None, now_ns: int) -> None:
        """Take a datagram of the vehicle link; a malformed one is counted and changes nothing."""
        with self._lock:
            try:
                command = link.decode_command(datagram)
            except link.LinkError as error:
                self._errors.append(f"vehicle link: {error}")
                return
            if sender:
                self._listeners[sender] = now_ns
            if isinstance(command, link.Setpoint):
                self._integrate(now_ns)
                self._setpoint, self._heard_ns = command, now_ns

    def take_errors(self) -> list[str]:
        """Remove and return what was wrong with datagrams since the last call, oldest first."""
        with self._lock:
            errors = list(self._errors)
            self._errors.clear()
        return errors

    def telemetry(self, now_ns: int) -> tuple[bytes, list[str]]:
        """Return what the vehicle measures at `now_ns`, and to whom to send it."""
        motion = self.at(now_ns)
        with self._lock:
            recent = now_ns - round(link.CLIENT_MEMORY_S * NS_PER_S)
            self._listeners = {a: ns for a, ns in self._listeners.items() if ns >= recent}
            listeners = list(self._listeners)
        message = link.Telemetry(
            time_ns=now_ns,
            x_m=motion.x_m,
            y_m=motion.y_m,
            z_m=motion.z_m,
            yaw_rad=wrap(motion.yaw_rad),
            forward_mps=motion.forward_mps,
            lateral_mps=motion.lateral_mps,
            yaw_rate_radps=motion.yaw_rate_radps,
            flying=motion.z_m > FLYING_M if self._airborne else True,
            battery=math.exp(-self.simulated_s / BATTERY_S),
        )
        return link.encode(message), listeners

    def _integrate(self, now_ns: int) -> None:
        if now_ns - self._at_ns > LONGEST_JUMP_NS:
            self._at_ns = now_ns - LONGEST_JUMP_NS
        while self._at_ns < now_ns:
            step_ns = min(STEP_NS, now_ns - self._at_ns)
            self._at_ns += step_ns
            self._simulated_ns += step_ns
            held = self._at_ns - self._heard_ns > self._link_loss_ns
            setpoint = link.HOLD if held else self._setpoint
            velocity = Velocity(
                forward_mps=_within(setpoint.forward_mps, 50),
                lateral_mps=_within(setpoint.lateral_mps, 50),
                vertical_mps=_within(setpoint.vertical_mps, 50),
                yaw_rate_radps=_within(setpoint.yaw_rate_radps, 20),
            )
            self._motion = self._vehicle.step(
                self._motion, velocity, step_ns / NS_PER_S, setpoint.brake
            )

    @contextmanager
    def linked(self, flight_dir: Path, now: Callable[[], int]) -> Generator[None, None, None]:
        """Serve the vehicle link in `flight_dir` in a thread until the `with` block ends.

        Args:
            flight_dir: where the link's socket is.
            now: reads the monotonic clock, nanoseconds.
        """
        end, ended = link.open_server(flight_dir), threading.Event()
        thread = threading.Thread(target=self._serve, args=(end, ended, now), daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(timeout=2.0)
            end.close()
            link.server_address(flight_dir).unlink(missing_ok=True)

    def _serve(self, end: socket.socket, ended: threading.Event, now: Callable[[], int]) -> None:
        period_ns = round(NS_PER_S / link.TELEMETRY_HZ)
        while not ended.is_set():
            select([end], [], [], STEP_NS / NS_PER_S)
            for datagram, sender in _waiting(end):
                self.hear(datagram, sender, now())
            now_ns = now()
            self.at(now_ns)
            if now_ns - self._telemetry_ns >= period_ns:
                self._telemetry_ns = now_ns
                _send(end, *self.telemetry(now_ns))


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _waiting(end: socket.socket) -> Generator[tuple[bytes, str | None], None, None]:
    while True:
        try:
            datagram, sender = end.recvfrom(link.MAX_DATAGRAM)
        except OSError:
            return
        yield datagram, sender if isinstance(sender, str) else None


def _send(end: socket.socket, datagram: bytes, listeners: list[str]) -> None:
    for address in listeners:
        try:
            end.sendto(datagram, address)
        except OSError:
            continue  # it has gone, or does not read: its telemetry is lost, nobody else's
