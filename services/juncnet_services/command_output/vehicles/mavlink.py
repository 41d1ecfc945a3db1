"""PX4 and ArduPilot over MAVLink: UDP, TCP or a serial port. Needs the extra [mavlink].

An autopilot goes on with its last setpoint for as long as its parameters say, and then does what
they say: they are read at connection, and where a lost link would fly on nothing takes off.
"""

import os
import re
import socket
import termios
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, field_validator

from juncnet_services.command_output.vehicles import DriverOptions, Hold, usual_capabilities
from juncnet_services.command_output.vehicles.mavlink_flight import Flight, MavlinkCore
from juncnet_services.command_output.vehicles.pacing import (
    Link,
    LinkGoneError,
    PacedVehicle,
)

URL = re.compile(r"(udpin|udpout|tcp):([^:]+):(\d+)|serial:(/[^:]+):(\d+)")
CONNECT_S = 3.0
END_S = {"hold": 0.3, "land": 2.4}
"""Time at the end for zero velocity, and for a landing to begin or a rover to be disarmed."""


class MavlinkOptions(DriverOptions, Flight):
    """Options of the vehicle `mavlink`."""

    url: str = "udpin:127.0.0.1:14540"
    """udpin:ADDRESS:PORT to listen, udpout:HOST:PORT to call, serial:/dev/ttyACM0:921600, or
    tcp:HOST:PORT for simulators: over a bad link TCP delivers setpoints late instead of never."""
    at_end: Literal["hold", "land"] = "hold"
    """What the vehicle does when command_output ends in order; a rover is disarmed by `land`."""
    minimum_radius_m: float = Field(default=2.5, ge=0, le=100)
    """Of a rover's turns; 0: it turns in place."""

    @field_validator("url")
    @classmethod
    def _is_a_link(cls, url: str) -> str:
        if URL.fullmatch(url) is None:
            raise ValueError(
                "write udpin:ADDRESS:PORT, udpout:HOST:PORT, tcp:HOST:PORT or "
                "serial:/dev/DEVICE:BAUD"
            )
        return url


class MavlinkVehicle(PacedVehicle):
    """An autopilot that speaks MAVLink 2."""

    Options: ClassVar[type[DriverOptions]] = MavlinkOptions

    def __init__(self, options: MavlinkOptions, flight_dir: Path) -> None:
        del flight_dir
        self._autopilot = MavlinkCore(options)
        super().__init__(self._autopilot)
        capabilities = usual_capabilities(options.kind, telemetry=True)
        if options.kind == "rover":
            radius_m = options.minimum_radius_m
            changes = {"minimum_radius_m": radius_m, "turns_in_place": radius_m == 0}
            capabilities = capabilities.model_copy(update=changes)
        self.capabilities = capabilities
        self._at_end: Literal["hold", "land"] = options.at_end
        self._hold: Hold | None = None
        self._link = _open(options.url, lambda: self._autopilot.seen.system is not None)
        self.start()

    @contextmanager
    def connect(self) -> Generator[Link]:
        self._link.begin()
        yield self._link

    def hold(self) -> Hold | None:
        """Return a hold for the autopilot that is known; until one is anew, for the one before.

        Whoever else is heard meanwhile is not held, and the autopilot is where it was, if anywhere.
        """
        with self._lock:
            if self._autopilot.seen.system is not None:
                packet = self._autopilot.hold_packet()
                self._hold = Hold(self._link.fileno(), self._link.peer, (packet,))
        return self._hold

    def close(self) -> None:
        self.finish(self._at_end == "land", END_S[self._at_end])
        self._link.close()


class UdpLink:
    """Speaks with one peer: the named one, or the one whose datagram made it `known`.

    `known`: whether the autopilot is. Until then the peer is whoever was heard last, so that a
    stranger who is heard first, such as a port scanner, keeps nobody out.
    """

    def __init__(self, host: str, port: int, known: Callable[[], bool], *, listen: bool) -> None:
        self.peer: tuple[str, int] | None = None
        self._known = known
        self._named = None if listen else (socket.gethostbyname(host), port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # The guard of a dead predecessor still has the port, and reads nothing: the newest reads.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((host, port) if listen else ("", 0))
        except OSError as error:
            self._socket.close()
            raise ValueError(
                f"cannot listen on {host}:{port}: {error}; does another program have the port?"
            ) from error

    def begin(self) -> None:
        """Look for the peer from now on, unless it is named; the one before is spoken to until."""
        self.peer = self._named or self.peer

    def fileno(self) -> int:
        return self._socket.fileno()

    def send(self, data: bytes) -> None:
        if self.peer is not None:
            self._socket.sendto(data, self.peer)

    def receive(self) -> bytes | None:
        data, sender = self._socket.recvfrom(65_535)
        if self._named is None and not self._known():
            self.peer = sender
        return data if sender == self.peer else None

    def close(self) -> None:
        self._socket.close()


class TcpLink:
    """A connection to a server; once it is lost the process ends, for the guard has it too."""

    peer = None

    def __init__(self, host: str, port: int) -> None:
        self._server = (host, port)
        self._socket: socket.socket | None = None

    def begin(self) -> None:
        """Connect; a connection that has been made is kept, whoever is silent on it.

        Raises:
            ConnectionError: nobody answers there.
        """
        if self._socket is not None:
            return
        try:
            link = socket.create_connection(self._server, CONNECT_S)
        except OSError as error:
            host, port = self._server
            raise ConnectionError(
                f"no MAVLink at tcp:{host}:{port} ({error}): is the simulator on?"
            ) from error
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setblocking(False)
        self._socket = link

    @property
    def _made(self) -> socket.socket:
        if self._socket is None:
            raise ConnectionError("not connected yet")
        return self._socket

    def fileno(self) -> int:
        return self._made.fileno()

    def send(self, data: bytes) -> None:
        self._made.send(data)

    def receive(self) -> bytes:
        try:
            data = self._made.recv(65_535)
        except BlockingIOError:
            raise
        except OSError as error:
            raise LinkGoneError(f"the connection is gone: {error}") from error
        if not data:
            raise LinkGoneError("the connection is gone: the other end closed it")
        return data

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()


class SerialLink:
    """A serial port, raw, at `baud`."""

    peer = None

    def __init__(self, device: str, baud: int) -> None:
        speed: int | None = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise ValueError(f"{device}: {baud} is no baud rate of this system")
        try:
            self._port = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            raw = termios.tcgetattr(self._port)
        except (OSError, termios.error) as error:
            raise ValueError(
                f"{device}: {error}; is the autopilot plugged in, is the user in group dialout?"
            ) from error
        raw[0] = raw[1] = raw[3] = 0
        raw[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
        raw[4] = raw[5] = speed
        termios.tcsetattr(self._port, termios.TCSANOW, raw)

    def begin(self) -> None:
        """Drop what has piled up while nobody read."""
        try:
            termios.tcflush(self._port, termios.TCIFLUSH)
        except termios.error as error:
            raise LinkGoneError(f"the serial port is gone: {error}") from error

    def fileno(self) -> int:
        return self._port

    def send(self, data: bytes) -> None:
        os.write(self._port, data)

    def receive(self) -> bytes:
        try:
            data = os.read(self._port, 4096)
        except BlockingIOError:
            raise
        except OSError as error:
            raise LinkGoneError(f"the serial port is gone: {error}") from error
        if not data:
            raise LinkGoneError("the serial port is gone: unplugged")
        return data

    def close(self) -> None:
        os.close(self._port)


def _open(url: str, known: Callable[[], bool]) -> UdpLink | TcpLink | SerialLink:
    """Return the link; raises `ValueError` that says what to do when it cannot be opened."""
    match = URL.fullmatch(url)
    assert match is not None, "validated before"
    direction, host, port, device, baud = match.groups()
    if device is not None:
        return SerialLink(device, int(baud))
    if direction == "tcp":
        return TcpLink(host, int(port))
    return UdpLink(host, int(port), known, listen=direction == "udpin")
