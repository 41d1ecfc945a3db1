"""A vehicle's side in this process, for tests: command_output and the router, over real Zenoh."""

import itertools
import shutil
import socket
import tempfile
import threading
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import peers
from juncnet import links
from juncnet.access import Role
from juncnet.flight import Flight, new_flight
from juncnet.identity import CERTIFICATE, KEY, Identity, read_identity
from juncnet.launch import connect, open_gateway
from juncnet.messages import Override, OverrideKind, Velocity, VelocityCommand
from juncnet.topics import COMMAND_OVERRIDE, COMMAND_VELOCITY
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.certificates import main as make_certificates
from juncnet_services.command_output.service import Config, run
from keeping_vehicle import KeepingVehicle

AHEAD = Velocity(forward_mps=1.5)
ROBOT = "robot"


def certificates(folder: Path) -> Path:
    """Return a folder with a certificate a role, of a CA of its own."""
    assert make_certificates([str(folder)]) == 0
    return folder


def free_address() -> str:
    """Return an address on which nobody listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@dataclass
class VehicleSide:
    """A running command_output, its router's address, and the certificates for it."""

    bus: ZenohBus
    flight: Flight
    address: str
    folder: Path

    def linked(self, role: Role) -> ZenohBus:
        """Return a bus that is linked to the router with the certificate of `role`."""
        return connect(self.address, ROBOT, certificates=self.folder / role)

    def counter(self, name: str) -> float:
        """Return a counter of command_output's health."""
        report = self.bus.health.report(self.bus.stamp(), self.flight.id, 0, 0)
        return report.counters.get(name, 0.0)


@contextmanager
def vehicle_side(folder: Path) -> Generator[VehicleSide]:
    """Run command_output with a vehicle that keeps what it is told, and a router with TLS."""
    KeepingVehicle.forget()
    address = free_address()
    with ExitStack() as stack:
        root = stack.enter_context(tempfile.TemporaryDirectory(prefix="jn-"))
        flight = new_flight(ROBOT, ("command_output", links.ROUTER), Path(root))
        bus = stack.enter_context(peers.member(flight, "command_output"))
        identity = read_identity(folder / Role.DRONE)
        stack.enter_context(open_gateway(flight, f"tls/{address}", identity))
        config = Config(vehicle="keeping_vehicle:KeepingVehicle", loss_latch_s=60)
        thread = threading.Thread(target=run, args=(bus, config))
        thread.start()
        try:
            yield VehicleSide(bus, flight, address, folder)
        finally:
            bus.stop()
            thread.join(10.0)


def fresh_command(bus: ZenohBus, velocity: Velocity = AHEAD) -> VelocityCommand:
    """Return a command of now that nothing is wrong with."""
    return VelocityCommand(header=bus.stamp(), issued=bus.stamp(), velocity=velocity)


def orders(bus: ZenohBus) -> Iterator[Override]:
    """Return orders of now, without end: each would move or end a flight if it were obeyed."""
    kinds = (OverrideKind.MANUAL, OverrideKind.TAKE_OFF, OverrideKind.LAND, OverrideKind.EMERGENCY)
    for kind in itertools.cycle(kinds):
        velocity = AHEAD if kind is OverrideKind.MANUAL else None
        yield Override(issued=bus.stamp(), kind=kind, velocity=velocity)


def send_all_kinds(bus: ZenohBus, count: int) -> None:
    """Send `count` commands and orders, half and half, in every way that Zenoh knows."""
    session: Any = bus.session
    for number, order in zip(range(count // 2), orders(bus), strict=False):
        command = fresh_command(bus)
        if number % 4 == 3:
            session.put(f"juncnet/*/{COMMAND_VELOCITY.key}", command.encode()[0])
            session.put("juncnet/**", order.encode()[0])
        else:
            bus.publish(COMMAND_VELOCITY, command)
            bus.publish(COMMAND_OVERRIDE, order)


def settings_of(address: str, tls: dict[str, Any] | None) -> dict[str, Any]:
    """Return Zenoh settings of a client that tries to link again and again."""
    settings = links.outsider(f"{'tcp' if tls is None else 'tls'}/{address}")
    settings["mode"] = "peer"
    settings["connect"] |= {"timeout_ms": -1, "exit_on_failure": False}
    if tls is not None:
        settings["transport"]["link"]["tls"] = tls
    return settings


def foreign_identity(ours: Path, theirs: Path, scratch: Path) -> Identity:
    """Return an identity that trusts our CA, with navigation's certificate of another CA."""
    shutil.copytree(ours / Role.NAVIGATION, scratch)
    for name in (CERTIFICATE, KEY):
        shutil.copy(theirs / Role.NAVIGATION / name, scratch / name)
    return Identity(scratch, Role.NAVIGATION, read_identity(ours / Role.NAVIGATION).ends)


def stranger(settings: dict[str, Any]) -> ZenohBus:
    """Return a bus with these settings, linked or not."""
    return ZenohBus(settings, Flight("outside", Path(), ROBOT, ()), "stranger", Path())
