"""The seam of vehicles: what a driver does, and how the configured one is found.

A driver is one file here, or a class `package.module:Class` from anywhere: it has `Options` (its
pydantic model) and is made with `(options, flight_dir)`. It converts units and axes, in that one
place. Nothing outside of it knows its name.
"""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, cast, runtime_checkable

from pydantic import BaseModel, ConfigDict, ValidationError

from juncnet.messages import Capabilities, GeoPoint, Pose, Velocity

SHIPPED = {
    "simulated": "juncnet_services.command_output.vehicles.simulated:SimulatedVehicle",
    "log": "juncnet_services.command_output.vehicles.log:LogVehicle",
    "bebop": "juncnet_services.command_output.vehicles.bebop:BebopVehicle",
    "mavlink": "juncnet_services.command_output.vehicles.mavlink:MavlinkVehicle",
    "ros2": "juncnet_services.command_output.vehicles.ros2:Ros2Vehicle",
}


class DriverOptions(BaseModel):
    """Base of a driver's options: frozen, a mistyped option is an error that names it."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True)
class Hold:
    """Ready hold packets and where they go, for the guard process.

    `link`: descriptor of the socket, or of the serial port, that the driver itself sends on.
    `address`: as `sendto` takes it; None for a connected socket or a port. `packets` are sent in
    turn, over and over. A protocol that numbers its packets gives one for each number and takes
    the number from the clock: `step_ns` nanoseconds of monotonic time each; the guard does so too,
    and neither has to know what the other has sent.
    """

    link: int
    address: str | tuple[str, int] | None
    packets: tuple[bytes, ...]
    step_ns: int = 0


@dataclass(frozen=True)
class Telemetry:
    """What a vehicle measures; None: not known."""

    yaw_rad: float | None = None
    velocity: Velocity | None = None
    pose: Pose | None = None
    gps: GeoPoint | None = None
    battery: float | None = None
    flying: bool = True


class Vehicle(Protocol):
    """A driver. Calls never block; a link that is down is survived, counted, and comes back.

    A driver never arms and never takes off unless `take_off` is called.
    """

    Options: ClassVar[type[DriverOptions]]

    def __init__(self, options: Any, flight_dir: Path) -> None: ...

    @property
    def capabilities(self) -> Capabilities: ...

    @property
    def send_failures(self) -> int:
        """Setpoints that could not be sent since the start."""
        ...

    @property
    def trouble(self) -> str:
        """Why the vehicle will not fly, and the remedy; empty when it will."""
        ...

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        """Send a setpoint, within all limits; called at 25 Hz and on every change.

        `brake`: this is a hold. The vehicle shall come to rest and stay there; `velocity` is where
        it is on its way to rest, for vehicles that have no hold of their own.
        `lasts_s`: a driver that repeats setpoints in a thread of its own holds after so long
        without a newer call.
        """
        ...

    def take_off(self) -> None:
        """Arm, and take off what flies; called once for an operator's order, between holds.

        A driver that goes on with it by itself afterwards is an `AbortsTakeOff`, too.
        """
        ...

    def land(self) -> None:
        """Land, or stop where it is on the ground; called at 25 Hz while landing."""
        ...

    def emergency(self) -> None:
        """Cut the motors; called at 25 Hz after an operator's emergency."""
        ...

    def hold(self) -> Hold | None:
        """Return what the guard needs now; None where there is no link to guard, or none yet.

        Asked after every setpoint. The first answer that is not None ends the guard of a dead
        predecessor: give it when setpoints reach the vehicle, and from then on.
        """
        ...

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        """Return the newest measurement; None when it came longer than `max_age_s` ago."""
        ...

    def close(self) -> None:
        """End in order, as the options say: held, or landing. Gives the link up; at most 3 s."""
        ...


@runtime_checkable
class AbortsTakeOff(Protocol):
    """A vehicle whose take-off can be given up; one without this finishes it in spite of a stop."""

    def abort_take_off(self) -> None:
        """Go on with the take-off no more: disarm on the ground, keep the height in the air.

        Called once at the first stop after `take_off`, before its hold. The take-off may be long
        over by then: nothing changes. Never disarm what may be in the air.
        """
        ...


def usual_capabilities(kind: Literal["copter", "rover"], *, telemetry: bool) -> Capabilities:
    """Return what a copter can do, or a rover that steers like a car."""
    copter = kind == "copter"
    return Capabilities(
        kind=kind,
        lateral=copter,
        vertical=copter,
        turns_in_place=copter,
        minimum_radius_m=0.0 if copter else 2.5,
        telemetry=telemetry,
    )


def driver(name: str) -> type[Vehicle]:
    """Return the class of the driver `name`: a shipped one, or `package.module:Class`.

    Raises:
        ValueError: there is no such driver; the text says why.
    """
    module, _, attribute = SHIPPED.get(name, name).partition(":")
    if not attribute:
        known = ", ".join(SHIPPED)
        raise ValueError(f"no vehicle {name!r}: use {known} or package.module:Class")
    try:
        return cast("type[Vehicle]", getattr(importlib.import_module(module), attribute))
    except (ImportError, AttributeError) as error:
        raise ValueError(f"vehicle {name!r} cannot be loaded: {error}") from error


def check_options(name: str, options: Mapping[str, Any]) -> None:
    """Return if the driver `name` exists and takes `options`.

    Raises:
        ValueError: it does not; the text names the option.
    """
    try:
        driver(name).Options.model_validate(options)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(("options", *map(str, first["loc"])))
        raise ValueError(f"vehicle {name!r}, {where}: {first['msg']}") from error


def open_vehicle(name: str, options: Mapping[str, Any], flight_dir: Path) -> Vehicle:
    """Return the driver `name`, made with its validated `options`.

    Raises:
        ValueError: no such driver, or options that it refuses (pydantic's error names them).
    """
    found = driver(name)
    return found(found.Options.model_validate(options), flight_dir)
