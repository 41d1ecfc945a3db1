"""Nobody without the right moves the robot: strangers of five kinds, over real Zenoh and TLS.

Fifty commands of each kind by default, a thousand with `--full`.
"""

import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

import peers
import vehicle_side as side
from juncnet.access import Role
from juncnet.identity import CA, read_identity
from juncnet.launch import connect
from juncnet.messages import (
    Ack,
    Mission,
    Output,
    Override,
    OverrideKind,
    SetMission,
    VehicleState,
    Velocity,
    VelocityCommand,
)
from juncnet.topics import (
    COMMAND_ACK,
    COMMAND_OVERRIDE,
    COMMAND_VELOCITY,
    MISSION_SET,
    VEHICLE_STATE,
    Topic,
)
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.operator import order
from keeping_vehicle import KeepingVehicle
from vehicle_side import VehicleSide

COUNTS = [50, pytest.param(1000, marks=pytest.mark.full)]
counts = pytest.mark.parametrize("count", COUNTS)
BURST = 10
PAUSE_S = 0.02


@pytest.fixture(name="folder", scope="module")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return side.certificates(tmp_path_factory.mktemp("ours") / "certificates")


@pytest.fixture(name="vehicle")
def _vehicle(folder: Path) -> Iterator[VehicleSide]:
    with side.vehicle_side(folder) as vehicle:
        yield vehicle


def flies_for_navigation(vehicle: VehicleSide) -> None:
    """Check that what strangers cannot do is done for who may."""
    with vehicle.linked(Role.NAVIGATION) as navigation:

        def told() -> bool:
            navigation.publish(COMMAND_VELOCITY, side.fresh_command(navigation))
            return bool(KeepingVehicle.told)

        assert peers.eventually(told)
    KeepingVehicle.forget()


def send(bus: ZenohBus, count: int) -> None:
    """Send so many commands, over a time in which a link would be made."""
    for _ in range(count // BURST):
        side.send_all_kinds(bus, BURST)
        time.sleep(PAUSE_S)


def nothing_happened(vehicle: VehicleSide) -> bool:
    """Return whether the vehicle was told nothing, and nobody asked command_output for anything."""
    return not (KeepingVehicle.told or KeepingVehicle.done) and not any(
        vehicle.counter(f"refused_{name}")
        for name in ("command_stale", "command_replayed", "command_age_unknown", "picture_stale")
    )


def tls_of(kind: str, folder: Path, scratch: Path) -> dict[str, Any] | None:
    """Return the TLS settings of a stranger who has no certificate, another CA's, or no TLS."""
    if kind == "plain TCP":
        return None
    if kind == "no certificate":
        return {"root_ca_certificate": str(folder / Role.VIEWER / CA), "enable_mtls": False}
    theirs = side.certificates(scratch / "theirs")
    return side.foreign_identity(folder, theirs, scratch / "stranger").tls()


@counts
@pytest.mark.parametrize("kind", ["no certificate", "wrong CA", "plain TCP"])
def test_a_stranger_is_not_let_in(
    vehicle: VehicleSide, folder: Path, tmp_path: Path, kind: str, count: int
) -> None:
    settings = side.settings_of(vehicle.address, tls_of(kind, folder, tmp_path))
    with side.stranger(settings) as stranger:
        send(stranger, count)
        time.sleep(0.3)
        side.send_all_kinds(stranger, BURST)
        assert not stranger.connected
    assert nothing_happened(vehicle)
    flies_for_navigation(vehicle)


def test_the_same_attempt_with_our_certificate_is_let_in(
    vehicle: VehicleSide, folder: Path
) -> None:
    tls = read_identity(folder / Role.NAVIGATION).tls()
    with side.stranger(side.settings_of(vehicle.address, tls)) as welcome:
        assert peers.eventually(lambda: welcome.connected)


@counts
@pytest.mark.parametrize("role", [Role.VIEWER, Role.RECORDER])
def test_who_may_look_moves_nothing(vehicle: VehicleSide, role: Role, count: int) -> None:
    with vehicle.linked(role) as viewer:
        assert viewer.subscribe(VEHICLE_STATE).take(10.0) is not None
        send(viewer, count)
        mission = SetMission(mission=Mission(name="mine"))
        assert not viewer.request(MISSION_SET, mission, 0.3).accepted
    assert nothing_happened(vehicle)
    flies_for_navigation(vehicle)


def test_navigation_overrides_nothing_and_an_operator_steers_nothing(vehicle: VehicleSide) -> None:
    with vehicle.linked(Role.OPERATOR) as operator:
        acks = operator.subscribe(COMMAND_ACK, 64)
        with vehicle.linked(Role.NAVIGATION) as navigation:
            flies_for_navigation(vehicle)
            for _ in range(20):
                held = Override(issued=navigation.stamp(), kind=OverrideKind.LAND)
                navigation.publish(COMMAND_OVERRIDE, held)
                operator.publish(COMMAND_VELOCITY, side.fresh_command(operator))
            time.sleep(0.3)
        assert acks.drain() == []
        assert KeepingVehicle.done == []
        assert vehicle.counter("refused_command_replayed") == 0
        answer, _ = order(operator, OverrideKind.HOLD, "anna", 5.0)
        assert answer is not None
        assert answer.accepted


class Eavesdropper:
    """Keeps the bytes of every message under a key, as a viewer hears them."""

    def __init__(self, bus: ZenohBus, topic: Topic[Any]) -> None:
        self.heard: list[bytes] = []
        self._key = topic.expression(side.ROBOT)
        self._declared = bus.session.declare_subscriber(self._key, self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard.append(sample.payload.to_bytes())

    def play(self, bus: ZenohBus, payload: bytes) -> None:
        """Send what was heard, byte for byte, over the link of `bus`."""
        session: Any = bus.session
        session.put(self._key, payload)


@counts
def test_replayed_velocities_are_refused_while_fresh_and_later(
    vehicle: VehicleSide, count: int
) -> None:
    with (
        vehicle.linked(Role.NAVIGATION) as navigation,
        vehicle.linked(Role.VIEWER) as viewer,
        vehicle.linked(Role.NAVIGATION) as thief,
    ):
        ears = Eavesdropper(viewer, COMMAND_VELOCITY)
        flies_for_navigation(vehicle)

        def standing() -> VelocityCommand:
            command = side.fresh_command(navigation, Velocity())
            navigation.publish(COMMAND_VELOCITY, command)
            return command

        # Fresh: a motion, then zero from the navigator, while somebody repeats the motion.
        assert peers.eventually(lambda: bool(standing()) and len(ears.heard) > 0)
        deadline = time.monotonic() + 120
        while vehicle.counter("refused_command_replayed") < count / BURST:
            assert time.monotonic() < deadline
            KeepingVehicle.forget()
            motion = side.fresh_command(navigation)
            navigation.publish(COMMAND_VELOCITY, motion)
            payload = motion.encode()[0]
            assert peers.eventually(lambda heard=payload: heard in ears.heard)
            standing()
            time.sleep(PAUSE_S)
            for _ in range(BURST):
                ears.play(thief, payload)
                ears.play(viewer, payload)
                time.sleep(0.001)
            assert slows_down_once(KeepingVehicle.speeds)
        # Later: nobody commands any more, and all that was ever heard is repeated.
        states = viewer.subscribe(VEHICLE_STATE)
        assert peers.eventually(lambda: _stands(states.take(1.0)))
        KeepingVehicle.forget()
        for payload in itertools.islice(itertools.cycle(list(ears.heard)), count):
            ears.play(thief, payload)
            ears.play(viewer, payload)
            time.sleep(0.001)
        time.sleep(0.3)
        assert KeepingVehicle.told == []
        assert vehicle.counter("refused_command_stale") > 0
    flies_for_navigation(vehicle)


def slows_down_once(speeds: list[float]) -> bool:
    """Return whether nothing moved the robot again once it was told to stand still."""
    steps = [after - before for before, after in itertools.pairwise(list(speeds))]
    slower = next((at for at, step in enumerate(steps) if step < 0), len(steps))
    return all(step <= 0 for step in steps[slower:])


def _stands(state: VehicleState | None) -> bool:
    return state is not None and state.output is Output.HOLD and state.commanded == Velocity()


@counts
def test_a_replayed_resume_does_not_end_a_stop(vehicle: VehicleSide, count: int) -> None:
    with (
        vehicle.linked(Role.OPERATOR) as operator,
        vehicle.linked(Role.VIEWER) as viewer,
        vehicle.linked(Role.OPERATOR) as thief,
    ):
        ears = Eavesdropper(viewer, COMMAND_OVERRIDE)
        acks = thief.subscribe(COMMAND_ACK, 10_000)
        for kind in (OverrideKind.RESUME, OverrideKind.HOLD):
            answer, took_s = order(operator, kind, "anna", 5.0)
            assert answer is not None
            assert answer.accepted
            assert took_s < 5.0
        assert peers.eventually(lambda: any(_is_resume(text) for text in ears.heard))
        resumes = [text for text in ears.heard if _is_resume(text)]
        assert peers.eventually(lambda: _newest_kind(acks.drain()) is OverrideKind.HOLD)
        for payload in itertools.islice(itertools.cycle(resumes), count):
            ears.play(thief, payload)
            ears.play(viewer, payload)
            time.sleep(0.002)
        answers: list[Ack] = []
        assert peers.eventually(
            lambda: bool(answers.extend(a for _, a in acks.drain())) or len(answers) > count / 2
        )  # what comes too fast is dropped, and never answered
        assert not any(answer.accepted for answer in answers)
        state = viewer.subscribe(VEHICLE_STATE).take(5.0)
        assert state is not None
        assert state.output is Output.STOPPED


def _is_resume(payload: bytes) -> bool:
    return Override.decode(payload).kind is OverrideKind.RESUME


def _newest_kind(acks: list[tuple[str, Ack]]) -> OverrideKind | None:
    return acks[-1][1].kind if acks else None


def test_a_tool_without_the_right_certificates_is_told_so(
    vehicle: VehicleSide, folder: Path
) -> None:
    with pytest.raises(ConnectionError, match="dials nobody"):
        connect(vehicle.address, certificates=folder / Role.DRONE)
    with pytest.raises(ConnectionError, match="deploy/certificates"):
        connect(vehicle.address, certificates=folder / "nowhere")
