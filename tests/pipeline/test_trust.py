"""What links are allowed: who is let in where, what a viewer behind a laptop can do, operators."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from pydantic import ValidationError

import peers
import vehicle_side as side
from juncnet import links
from juncnet.access import Role
from juncnet.clocks import NS_PER_S
from juncnet.flight import Flight, new_flight
from juncnet.identity import read_identity
from juncnet.launch import connect, open_gateway
from juncnet.layout import LayoutError, load_layout
from juncnet.messages import Override, OverrideKind, RoadCommand, Velocity
from juncnet.topics import (
    COMMAND_ACK,
    COMMAND_OVERRIDE,
    COMMAND_VELOCITY,
    ROAD_COMMAND,
    VEHICLE_STATE,
)
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.operator import main as operator_main
from juncnet_services.cli.operator import order
from juncnet_services.router.service import Config
from keeping_vehicle import KeepingVehicle
from vehicle_side import VehicleSide


@pytest.fixture(name="folder", scope="module")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return side.certificates(tmp_path_factory.mktemp("ours") / "certificates")


@pytest.fixture(name="vehicle")
def _vehicle(folder: Path) -> Iterator[VehicleSide]:
    with side.vehicle_side(folder) as vehicle:
        yield vehicle


def test_a_router_is_not_open_by_accident(tmp_path: Path) -> None:
    for host in ("0.0.0.0", "192.168.1.2", "::", "drone.local"):
        with pytest.raises(ValidationError, match="deploy/certificates"):
            Config(host=host, port=0)
        Config(host=host, port=0, allow_anyone_on_the_network_to_fly_this_robot=True)
        Config(host=host, port=0, certificates=Path("/etc/juncnet/certificates"))
    Config(host="127.0.0.1", port=0)
    path = tmp_path / "open.toml"
    path.write_text('processes = ["router"]\n[router]\nhost = "0.0.0.0"\n')
    with pytest.raises(LayoutError, match="whoever reaches it could fly the robot"):
        load_layout(path).validate_all()
    path.write_text(
        path.read_text() + "[links]\nallow_anyone_on_the_network_to_fly_this_robot = true\n"
    )
    load_layout(path).validate_all()


def test_sockets_of_a_flight_are_out_of_others_reach(vehicle: VehicleSide) -> None:
    assert vehicle.flight.directory.stat().st_mode & 0o777 == 0o700
    assert list(vehicle.flight.directory.glob("*.zsock"))


class Laptop:
    """The other host: a navigator that is linked to the vehicle, and a gateway for viewers."""

    def __init__(self, stack: ExitStack, vehicle: VehicleSide, root: Path) -> None:
        self.flight: Flight = new_flight(side.ROBOT, ("junction_navigation", "router"), root)
        identity = read_identity(vehicle.folder / Role.NAVIGATION)
        remote = links.remote(vehicle.address, None, identity)
        settings = links.member(self.flight, "junction_navigation")
        directory = self.flight.directory
        self.navigator = stack.enter_context(
            ZenohBus(settings, self.flight, "junction_navigation", directory, "auto", remote=remote)
        )
        self.roads = self.navigator.subscribe(ROAD_COMMAND, 64)

    def flies(self) -> bool:
        """Command, and return whether the vehicle was told."""
        self.navigator.publish(COMMAND_VELOCITY, side.fresh_command(self.navigator))
        return bool(KeepingVehicle.told)


def road_command(bus: ZenohBus) -> RoadCommand:
    return RoadCommand(
        header=bus.stamp(), source="vision", velocity=Velocity(forward_mps=1), confidence=1.0
    )


@pytest.mark.parametrize("protected", [False, True])
def test_a_viewer_behind_a_laptop_reaches_the_laptop_and_not_the_vehicle(
    vehicle: VehicleSide, folder: Path, protected: bool
) -> None:
    """Its gateway passes nothing on to the vehicle. Without certificates whoever it lets in can
    talk to the laptop's own processes, a road to follow included; with them a viewer only looks."""
    with peers.a_flight() as place, ExitStack() as stack:
        laptop = Laptop(stack, vehicle, place.directory.parent)
        assert peers.eventually(laptop.flies)
        gateway, identity = side.free_address(), None
        if protected:
            identity = read_identity(folder / Role.DRONE)
        endpoint = links.endpoint(gateway, identity)
        stack.enter_context(open_gateway(laptop.flight, endpoint, identity))
        certificate = folder / Role.VIEWER if protected else None
        viewer = stack.enter_context(connect(gateway, side.ROBOT, certificates=certificate))
        commands = viewer.subscribe(COMMAND_VELOCITY, 64)
        assert peers.eventually(lambda: laptop.flies() and commands.take(0.1) is not None)
        assert viewer.subscribe(VEHICLE_STATE).take(0.5) is None
        KeepingVehicle.forget()
        orders = vehicle.bus.subscribe(COMMAND_OVERRIDE, 64)

        def steered() -> bool:
            viewer.publish(ROAD_COMMAND, road_command(viewer))
            side.send_all_kinds(viewer, 4)
            return laptop.roads.take(0.05) is not None

        assert peers.eventually(steered, 2.0 if protected else 10.0) is not protected
        assert orders.drain() == []
        assert KeepingVehicle.told == []
        assert KeepingVehicle.done == []
        assert peers.eventually(laptop.flies)


def test_an_operators_orders_are_confirmed_over_a_link(
    vehicle: VehicleSide, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kinds = (OverrideKind.HOLD, OverrideKind.RESUME, OverrideKind.TAKE_OFF, OverrideKind.LAND)
    with vehicle.linked(Role.OPERATOR) as operator:
        for kind in kinds:
            ack, took_s = order(operator, kind, "anna", 5.0)
            assert ack is not None
            assert ack.accepted, ack.reason
            assert took_s < 5.0
    assert peers.eventually(lambda: {"take_off", "land"} <= set(KeepingVehicle.done))
    where = ["--flight", vehicle.address, "--certificates"]
    assert operator_main(["stop", *where, str(folder / Role.OPERATOR)]) == 0
    assert "stop: obeyed after" in capsys.readouterr().out
    assert operator_main(["stop", *where, str(folder / Role.VIEWER), "--timeout", "0.5"]) == 1
    assert "NO ANSWER" in capsys.readouterr().err


class OtherClock:
    """The clock of another host."""

    id = "boot-of-another-host"

    def now_ns(self) -> int:
        return time.monotonic_ns() + 5000 * NS_PER_S


def test_who_was_not_told_a_robots_name_orders_it_from_another_host(
    vehicle: VehicleSide, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("juncnet.process.HostClock", OtherClock)
        page = connect(vehicle.address, "somebody", certificates=folder / Role.OPERATOR)
    with page:
        answers = page.subscribe(COMMAND_ACK, 64, robot="*")

        def resumed() -> bool:
            resume = Override(issued=page.stamp(), kind=OverrideKind.RESUME)
            page.publish(COMMAND_OVERRIDE, resume, robot=side.ROBOT)
            page.wait(0.1)
            return any(ack.accepted for _, ack in answers.drain())

        assert peers.eventually(resumed)
