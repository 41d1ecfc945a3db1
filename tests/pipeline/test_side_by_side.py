"""Two flights of the same robot name on one machine do not hear each other."""

from pathlib import Path

from flights import SMALL_CAMERA, Flying
from juncnet.topics import (
    CAMERA_FRAME,
    COMMAND_VELOCITY,
    JUNCTION_EVENT,
    JUNCTION_SCORE,
    NAVIGATION_STATE,
    SIMULATOR_TRUTH,
)
from juncnet_services.cli.demo import prepare

SETTINGS = (*SMALL_CAMERA, "simulator.fps=12.0")
LISTEN_S = 8.0


class Ears:
    """What is heard on the bus of one flight: whose headers, whose flight ids."""

    def __init__(self, flying: Flying) -> None:
        self.flying = flying
        bus = flying.bus
        self.commands = bus.subscribe(COMMAND_VELOCITY, 2000)
        self.scores = bus.subscribe(JUNCTION_SCORE, 2000)
        self.truths = bus.subscribe(SIMULATOR_TRUTH, 2000)
        self.frames = bus.frames_in(CAMERA_FRAME)
        self.states = bus.subscribe(NAVIGATION_STATE, 2000)
        self.events = bus.subscribe(JUNCTION_EVENT, 2000)
        self.cameras: set[int] = set()
        """Epochs of the cameras whose pictures are seen, or followed by commands and scores."""
        self.simulators: set[int] = set()
        self.flights: set[str] = set()

    def hear(self) -> None:
        """Take all that has come."""
        self.flying.hear()
        with self.frames.take(0.0) as frame:
            if frame is not None:
                self.cameras.add(frame.header.epoch)
        for inbox in (self.commands, self.scores):
            self.cameras |= {message.header.epoch for _, message in inbox.drain()}
        self.simulators |= {truth.at.epoch for _, truth in self.truths.drain()}
        for inbox in (self.states, self.events):
            self.flights |= {message.flight for _, message in inbox.drain()}
        self.flights |= self.flying.flight_ids


def test_two_flights_hear_only_themselves(folder: Path) -> None:
    first = Flying(prepare("copter", None, 5, None, SETTINGS))
    second = Flying(prepare("copter", None, 6, None, SETTINGS))
    assert first.flight.robot == second.flight.robot
    with first, second:
        ears = Ears(first), Ears(second)
        for flying in (first, second):
            flying.all_report()
            flying.commands_flow()
        end_s = first.bus.clock.now_ns() / 1e9 + LISTEN_S
        while first.bus.clock.now_ns() / 1e9 < end_s:
            first.bus.wait(0.05)
            for one in ears:
                one.hear()
        for one in ears:
            assert one.flights == {one.flying.flight.id}
            assert len(one.cameras) == 1
            assert len(one.simulators) == 1
        assert ears[0].cameras.isdisjoint(ears[1].cameras)
        assert ears[0].simulators.isdisjoint(ears[1].simulators)
        assert set(first.pids.values()).isdisjoint(second.pids.values())
