"""A driver between command_output and another driver, that writes down every call."""

import base64
import json
import time
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from juncnet.messages import Capabilities, Velocity
from juncnet_services.command_output.vehicles import (
    AbortsTakeOff,
    DriverOptions,
    Hold,
    Telemetry,
    Vehicle,
    open_vehicle,
)


class ProbeOptions(DriverOptions):
    """Options of the probe."""

    driver: str
    """The driver that is looked at."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Its options."""
    log: Path
    """A line of JSON a call is added to this file: `call`, `at_ns` and `took_ns` (monotonic)."""


class ProbedVehicle:
    """The driver named in the options; what it raises is written down, and raised."""

    Options: ClassVar[type[DriverOptions]] = ProbeOptions

    def __init__(self, options: ProbeOptions, flight_dir: Path) -> None:
        self._log = options.log.open("a", buffering=1)
        self._told: Hold | None = None
        self._vehicle: Vehicle
        with _Call(self._log, "open"):
            self._vehicle = open_vehicle(options.driver, options.options, flight_dir)

    @property
    def capabilities(self) -> Capabilities:
        return self._vehicle.capabilities

    @property
    def send_failures(self) -> int:
        return self._vehicle.send_failures

    @property
    def trouble(self) -> str:
        return self._vehicle.trouble

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        with _Call(self._log, "send", brake=brake, **velocity.model_dump()):
            self._vehicle.send(velocity, brake, lasts_s)

    def take_off(self) -> None:
        with _Call(self._log, "take_off"):
            self._vehicle.take_off()

    def abort_take_off(self) -> None:
        if isinstance(self._vehicle, AbortsTakeOff):
            with _Call(self._log, "abort_take_off"):
                self._vehicle.abort_take_off()

    def land(self) -> None:
        with _Call(self._log, "land"):
            self._vehicle.land()

    def emergency(self) -> None:
        with _Call(self._log, "emergency"):
            self._vehicle.emergency()

    def hold(self) -> Hold | None:
        with _Call(self._log, "hold") as call:
            hold = self._vehicle.hold()
            if hold is not None and hold != self._told:
                call.fields["link"] = hold.link
                call.fields["packets"] = [base64.b64encode(p).decode() for p in hold.packets]
                self._told = hold
        return hold

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        with _Call(self._log, "telemetry") as call:
            seen = self._vehicle.telemetry(max_age_s)
            call.fields["seen"] = seen is not None
            call.fields["flying"] = seen is not None and seen.flying
        return seen

    def close(self) -> None:
        with _Call(self._log, "close"):
            self._vehicle.close()
        self._log.close()


class _Call:
    """A call that is written down when it has ended, with the name of what it raised."""

    def __init__(self, log: Any, name: str, **fields: Any) -> None:
        self.fields: dict[str, Any] = {"call": name, **fields}
        self._log = log
        self._began_ns = time.monotonic_ns()

    def __enter__(self) -> "_Call":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: Any) -> None:
        took_ns = time.monotonic_ns() - self._began_ns
        self.fields |= {"at_ns": self._began_ns, "took_ns": took_ns}
        if kind is not None:
            self.fields["raised"] = f"{kind.__name__}: {error}"
        self._log.write(json.dumps(self.fields) + "\n")
