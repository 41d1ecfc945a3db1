"""junction_navigation with a fake bus."""

from pathlib import Path
from typing import Any

from fakes import FakeBus
from juncnet import topics
from juncnet.messages import (
    Capabilities,
    EventKind,
    JunctionScore,
    Mission,
    ModelIdentity,
    Output,
    Phase,
    RoadCommand,
    SetMission,
    Stamp,
    VehicleState,
    Velocity,
)
from juncnet_services.junction_navigation.service import Config, run
from juncnet_services.junction_navigation.store import FILE_NAME

MODEL = ModelIdentity(name="m", sha256="0" * 64)
COPTER = Capabilities(kind="copter", turns_in_place=True, telemetry=True)
CONFIG = Config(mission=Mission(finish_after=1))


def frame(sequence: int, probability: float, source: str = "road_following") -> list[Any]:
    """The three inputs that one picture brings, 40 ms after the last."""

    def deliver(bus: FakeBus) -> None:
        bus.clock.advance(0.04)
        now = Stamp(epoch=1, sequence=sequence, time_ns=bus.clock.ns, clock=bus.clock.id)
        classes = {"none": 1 - probability, "junction": probability}
        forward = Velocity(forward_mps=3.0)
        state = VehicleState(
            at=now, capabilities=COPTER, yaw_rad=0.0, velocity=forward, output=Output.PIPELINE
        )
        road = RoadCommand(header=now, source=source, velocity=forward, confidence=0.9)
        score = JunctionScore(header=now, model=MODEL, probabilities=classes)
        for topic, message in (
            (topics.VEHICLE_STATE, state),
            (topics.ROAD_COMMAND, road),
            (topics.JUNCTION_SCORE, score),
        ):
            for inbox in bus._inboxes[topic.key]:  # pyright: ignore[reportPrivateUsage]  (fake)
                inbox.put(bus.robot, message)

    return [deliver, 0.001]


def drive(first: int, last: int, probability: float) -> list[Any]:
    return [step for i in range(first, last) for step in frame(i, probability)]


def approach() -> list[Any]:
    return [*drive(1, 30, 0.05), *drive(30, 125, 0.95)]


def test_a_junction_is_crossed_and_the_mission_finished(tmp_path: Path) -> None:
    bus = FakeBus([*approach(), *drive(125, 360, 0.05)], directory=tmp_path)
    run(bus, CONFIG)
    kinds = [event.kind for event in bus.published[topics.JUNCTION_EVENT.key]]
    assert kinds == [
        EventKind.APPROACHED,
        EventKind.ENTERED,
        EventKind.LEFT,
        EventKind.MISSION_FINISHED,
    ]
    commands = bus.published[topics.COMMAND_VELOCITY.key]
    assert commands[20].velocity.forward_mps == 3.0
    assert commands[20].header.sequence <= 21
    assert commands[-1].velocity == Velocity()
    assert bus.published[topics.NAVIGATION_STATE.key][-1].phase is Phase.FINISHED
    assert bus.health.errors == []


def test_a_restart_counts_the_junction_ahead_once(tmp_path: Path) -> None:
    first = FakeBus(approach(), directory=tmp_path)
    run(first, CONFIG)
    second = FakeBus([*drive(200, 210, 0.95), *drive(210, 460, 0.05)], directory=tmp_path)
    second.clock.ns = first.clock.ns
    run(second, CONFIG)
    events = [
        event for bus in (first, second) for event in bus.published[topics.JUNCTION_EVENT.key]
    ]
    told = {(event.index, event.kind) for event in events}
    assert [kind for _, kind in sorted(told)].count(EventKind.APPROACHED) == 1
    assert events[-1].kind is EventKind.MISSION_FINISHED
    assert events[-1].count == 1


def test_the_count_is_saved_before_it_is_told(tmp_path: Path) -> None:
    seen: list[bool] = []

    class Watching(FakeBus):
        def publish(self, topic: Any, message: Any, robot: str | None = None) -> None:
            if topic is topics.JUNCTION_EVENT:
                saved = (tmp_path / FILE_NAME).read_text()
                seen.append(f'"index":{message.index + 1}' in saved)
            super().publish(topic, message, robot)

    run(Watching(approach(), directory=tmp_path), CONFIG)
    assert seen == [True]


def test_another_flight_starts_at_zero(tmp_path: Path) -> None:
    run(FakeBus(approach(), directory=tmp_path), CONFIG)
    bus = FakeBus(drive(1, 10, 0.05), directory=tmp_path)
    bus.flight = "flight-2"
    run(bus, CONFIG)
    states = bus.published[topics.NAVIGATION_STATE.key]
    assert states[-1].count == 0
    assert "another flight" in states[0].reason


def test_a_wrong_source_is_an_error_and_moves_nothing(tmp_path: Path) -> None:
    script = [step for i in range(1, 10) for step in frame(i, 0.05, source="intruder")]
    bus = FakeBus(script, directory=tmp_path)
    run(bus, CONFIG)
    assert len(bus.health.errors) == 9
    assert "intruder" in bus.health.errors[0]
    assert all(c.velocity == Velocity() for c in bus.published[topics.COMMAND_VELOCITY.key])


def test_a_mission_is_set_by_request(tmp_path: Path) -> None:
    replies: list[Any] = []

    def ask(bus: FakeBus) -> None:
        request = SetMission(mission=Mission(name="other"))
        replies.append(bus.request(topics.MISSION_SET, request))

    bus = FakeBus([*drive(1, 5, 0.05), ask, *drive(5, 10, 0.05)], directory=tmp_path)
    run(bus, CONFIG)
    assert replies[0].accepted
    assert bus.published[topics.NAVIGATION_STATE.key][-1].mission.name == "other"


def test_pictures_that_stop_hold_the_robot(tmp_path: Path) -> None:
    bus = FakeBus([*drive(1, 10, 0.05), 0.05, 0.3, 0.05], directory=tmp_path)
    run(bus, CONFIG)
    assert bus.published[topics.COMMAND_VELOCITY.key][-1].velocity == Velocity()
    assert "older than" in bus.published[topics.NAVIGATION_STATE.key][-1].reason
