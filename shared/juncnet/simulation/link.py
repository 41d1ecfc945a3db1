"""The simulated vehicle's link: JSON datagrams over a UNIX socket, standard library only.

Client to simulator: `setpoint` and `hello`. Simulator to every client heard of late: `telemetry`.
The guard process of command_output speaks it too, so nothing here may import more than that.
"""

import json
import os
import socket
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TypeVar

SERVER_SOCKET = "vehicle.sock"
CLIENT_MEMORY_S = 2.0
"""Telemetry goes to every address that was heard of within this time."""
TELEMETRY_HZ = 50.0
MAX_DATAGRAM = 4096
_LIMIT = 1e9
_LONGEST = 2**63


class LinkError(ValueError):
    """A datagram is not what it should be; the text names the field and why."""


@dataclass(frozen=True)
class Setpoint:
    """A velocity of the vehicle's body: m/s forward, left, up; rad/s counter-clockwise."""

    forward_mps: float = 0.0
    lateral_mps: float = 0.0
    vertical_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    brake: bool = False
    """Stop as hard as the vehicle can, whatever the velocities say."""


@dataclass(frozen=True)
class Hello:
    """Asks for telemetry without commanding anything."""


@dataclass(frozen=True)
class Telemetry:
    """What the vehicle measures. Position is in its local frame; speeds are what it believes."""

    time_ns: int
    """Monotonic clock of the simulator's host."""
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    forward_mps: float
    lateral_mps: float
    yaw_rate_radps: float
    flying: bool
    battery: float
    """0..1."""


HOLD = Setpoint(brake=True)
"""Zero velocity: a copter keeps its place, a rover brakes."""

T = TypeVar("T", Setpoint, Telemetry)


def encode(message: Setpoint | Hello | Telemetry) -> bytes:
    """Return the datagram of a message."""
    return json.dumps({"type": type(message).__name__.lower(), **asdict(message)}).encode()


def decode_command(datagram: bytes) -> Setpoint | Hello:
    """Return what a client sent.

    Raises:
        LinkError: neither a setpoint nor a hello, or a field is missing, unknown or not finite.
    """
    values = _object(datagram)
    kind = values.pop("type", None)
    if kind == "hello":
        return Hello()
    if kind == "setpoint":
        return _checked(Setpoint, values)
    raise LinkError(f"type: expected 'setpoint' or 'hello', got {kind!r}")


def decode_telemetry(datagram: bytes) -> Telemetry:
    """Return what the simulator sent.

    Raises:
        LinkError: it is not telemetry, or a field is missing, unknown or not finite.
    """
    values = _object(datagram)
    kind = values.pop("type", None)
    if kind != "telemetry":
        raise LinkError(f"type: expected 'telemetry', got {kind!r}")
    return _checked(Telemetry, values)


def server_address(flight_dir: Path) -> Path:
    """Return where the simulator listens.

    Raises:
        LinkError: the path is longer than a UNIX socket's may be.
    """
    return _short(flight_dir / SERVER_SOCKET)


def open_client(flight_dir: Path, name: str = "client") -> socket.socket:
    """Return a non-blocking datagram socket bound to this process's own address in `flight_dir`.

    Send to `str(server_address(flight_dir))`; a missing simulator is an OSError there, at once.

    Args:
        flight_dir: the flight's directory.
        name: tells several sockets of one process apart.

    Raises:
        LinkError: the path is longer than a UNIX socket's may be.
        OSError: it cannot be bound.
    """
    own = _short(flight_dir / f"vehicle-{name}-{os.getpid()}.sock")
    return _bound(own)


def open_server(flight_dir: Path) -> socket.socket:
    """Return the simulator's non-blocking socket; takes the place of a dead simulator's."""
    return _bound(server_address(flight_dir))


def _bound(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        end.bind(str(path))
    except OSError:
        end.close()
        raise
    end.setblocking(False)
    return end


def _short(path: Path) -> Path:
    if len(os.fsencode(path)) > 103:
        raise LinkError(f"{path}: too long for a UNIX socket, choose a shorter flight directory")
    return path


def _object(datagram: bytes) -> dict[str, object]:
    try:
        values: object = json.loads(datagram)
    except (ValueError, RecursionError) as error:
        raise LinkError(f"datagram: not JSON ({error})") from error
    if not isinstance(values, dict):
        raise LinkError("datagram: not a JSON object")
    return {str(key): value for key, value in values.items()}  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]  # JSON


def _checked(cls: type[T], values: dict[str, object]) -> T:
    names = {f.name: getattr(f.type, "__name__", str(f.type)) for f in fields(cls)}
    unknown = values.keys() - names.keys()
    if unknown:
        raise LinkError(f"{min(unknown)}: unknown field")
    for name, wanted in names.items():
        if name not in values:
            raise LinkError(f"{name}: missing")
        value = values[name]
        if wanted == "bool":
            if not isinstance(value, bool):
                raise LinkError(f"{name}: expected true or false")
        elif isinstance(value, bool) or not isinstance(value, (int, float)):
            raise LinkError(f"{name}: expected a number")
        elif wanted == "int" and not isinstance(value, int):
            raise LinkError(f"{name}: expected an integer")
        elif not abs(value) < (_LONGEST if wanted == "int" else _LIMIT):
            raise LinkError(f"{name}: {value} is out of range")
    return cls(**values)  # pyright: ignore[reportArgumentType]  # every type was checked above
