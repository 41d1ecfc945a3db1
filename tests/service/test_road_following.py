"""road_following over the fake bus, with followers good and bad."""

import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from fakes import FakeBus
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import (
    EventKind,
    JunctionEvent,
    LoadFollower,
    PixelFormat,
    Reply,
    RoadCommand,
    Stamp,
    VehicleState,
    Velocity,
)
from juncnet.topics import (
    CAMERA_FRAME,
    FOLLOWER_ACTIVE,
    FOLLOWER_LOAD,
    JUNCTION_EVENT,
    ROAD_COMMAND,
)
from juncnet_services.road_following.follower import Proposal
from juncnet_services.road_following.runner import FollowerRunner, Watchdog
from juncnet_services.road_following.service import Config, run


class Straight:
    """What a user writes."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self.speed = options.get("speed_mps", 1.0)

    def follow(self, frame: Frame, state: VehicleState | None) -> Proposal:
        return Proposal(Velocity(forward_mps=self.speed))


class Erratic:
    """Answers by the frame's sequence: good, none, NaN, nonsense, an exception, a RoadCommand."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self.resets: list[str] = []

    def reset(self, reason: str) -> None:
        self.resets.append(reason)
        raise RuntimeError("no reset today")

    def follow(self, frame: Frame, state: VehicleState | None) -> Any:
        good = Proposal(Velocity(forward_mps=1.0))
        match frame.header.sequence:
            case 1:
                return None
            case 2:
                return Proposal(Velocity(), confidence=math.nan)
            case 3:
                return "straight on"
            case 4:
                raise ZeroDivisionError("road is too thin")
            case 5:
                other = Stamp(epoch=7, sequence=7, time_ns=7, clock="other")
                return RoadCommand(header=other, source="me", velocity=Velocity(), confidence=0.25)
            case _:
                return good


def frame(sequence: int) -> Frame:
    layout = FrameLayout.packed(PixelFormat.GRAY8, 64, 48)
    header = Stamp(epoch=1, sequence=sequence, time_ns=1_000 + sequence, clock="fake-clock")
    return Frame(header, layout, np.zeros(layout.nbytes, np.uint8))


def published(bus: FakeBus) -> list[RoadCommand]:
    return bus.published[ROAD_COMMAND.key]


def test_custom_follower_answers_every_frame_under_its_header() -> None:
    bus = FakeBus([(CAMERA_FRAME, frame(n)) for n in range(3)])
    run(
        bus,
        Config(follower=f"{__name__}:Straight", options={"speed_mps": 2.5}, source="mine"),
    )
    assert [c.header.sequence for c in published(bus)] == [0, 1, 2]
    assert {c.source for c in published(bus)} == {"mine"}
    assert all(c.velocity == Velocity(forward_mps=2.5) for c in published(bus))
    assert bus.health.outputs == 3
    assert bus.health.errors == []


def test_failing_follower_is_reported_and_the_robot_holds() -> None:
    bus = FakeBus([(CAMERA_FRAME, frame(n)) for n in range(7)])
    run(bus, Config(follower=f"{__name__}:Erratic"))
    commands = published(bus)
    assert [c.velocity is not None for c in commands] == [
        True,
        False,
        False,
        False,
        False,
        True,
        True,
    ]
    assert [c.header.sequence for c in commands] == list(range(7))
    assert commands[5].source == "road_following"
    assert commands[5].confidence == 0.25
    assert len(bus.health.errors) == 3
    for error, text in zip(bus.health.errors, ("confidence", "str", "too thin"), strict=True):
        assert text in error


def test_follower_is_reset_after_a_turn_and_may_fail_to() -> None:
    event = JunctionEvent(
        header=frame(0).header,
        flight="flight-1",
        index=1,
        kind=EventKind.TURN_FINISHED,
        count=3,
        probability=0.9,
    )
    bus = FakeBus([(JUNCTION_EVENT, event), (CAMERA_FRAME, frame(0))])
    run(bus, Config(follower=f"{__name__}:Erratic"))
    assert published(bus)[0].velocity is not None
    assert len(bus.health.errors) == 1
    assert "no reset today" in bus.health.errors[0]


def test_built_in_follower_runs_in_the_service() -> None:
    bus = FakeBus([(CAMERA_FRAME, frame(n)) for n in range(2)])
    run(bus, Config(options={"mask": "colour"}))
    assert len(published(bus)) == 2
    assert bus.health.errors == []


def test_hanging_follower_is_ended_and_a_quick_one_is_not() -> None:
    hung = threading.Event()
    texts: list[str] = []

    def on_hang(text: str) -> None:
        texts.append(text)
        hung.set()

    class Slow(Straight):
        def follow(self, frame: Frame, state: VehicleState | None) -> Proposal:
            assert hung.wait(10.0) == (frame.header.sequence == 1)
            return super().follow(frame, state)

    watchdog = Watchdog(0.05, "test:Slow", on_hang)
    quick = FollowerRunner(Straight({}), "test", watchdog, texts.append)
    for sequence in range(3):
        assert quick.command(frame(sequence), None).velocity is not None
    deadline = time.monotonic() + 0.1
    while time.monotonic() < deadline:
        assert texts == []
    slow = FollowerRunner(Slow({}), "test", watchdog, texts.append)
    assert slow.command(frame(1), None).velocity is not None
    assert len(texts) == 1
    assert "test:Slow hung" in texts[0]
    assert "time_limit_s = 0.05" in texts[0]


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_time_limit_must_be_positive(value: float) -> None:
    with pytest.raises(ValueError, match="time_limit_s"):
        Config(time_limit_s=value)


def test_follower_is_swapped_between_two_pictures_and_a_bad_one_is_refused() -> None:
    here = f"{__name__}:Straight"
    replies: list[Reply] = []

    def ask(follower: str, **options: Any) -> Callable[[FakeBus], None]:
        request = LoadFollower(follower=follower, options=options)
        return lambda bus: replies.append(bus.handlers[FOLLOWER_LOAD.key](request))

    bus = FakeBus(
        [
            (CAMERA_FRAME, frame(0)),
            ask(f"{__name__}:Erratic"),
            (CAMERA_FRAME, frame(5)),
            ask("no.such.module:Follower"),
            (CAMERA_FRAME, frame(6)),
            ask(here),
            (CAMERA_FRAME, frame(7)),
        ]
    )
    run(bus, Config(follower=here, options={"speed_mps": 2.5}))
    assert [reply.accepted for reply in replies] == [True, False, True]
    assert "no.such.module" in replies[1].reason
    assert "stays" in replies[1].reason
    speeds = [c.velocity and c.velocity.forward_mps for c in published(bus)]
    assert speeds == [2.5, 0.0, 1.0, 2.5]
    active = [message.follower for message in bus.published[FOLLOWER_ACTIVE.key]]
    assert active == [here, f"{__name__}:Erratic", here]
