"""A recording through the present code, frame by frame: what would now be decided differently?

Runs as fast as the machine can, in the time of the recording, with no bus: the same result each
time. Pictures went through H.264 on their way into the recording, so probabilities differ a little
even where nothing was changed: a verdict is another one when its probability has crossed one half
and moved by more than `MARGIN`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from juncnet.assets import asset_path
from juncnet.clocks import Instant
from juncnet.features import Extractor
from juncnet.layout import Layout
from juncnet.messages import JunctionScore, NavigationState, RoadCommand, Stamp, VehicleState
from juncnet.recording.reader import Recorded, Recording, RecordingError
from juncnet.recording.video import VideoDecoder
from juncnet.topics import (
    CAMERA_VIDEO,
    JUNCTION_SCORE,
    NAVIGATION_STATE,
    ROAD_COMMAND,
    VEHICLE_STATE,
)
from juncnet_services.cli.replay_play import Comparison, Happened, recorded_events, recorded_layout
from juncnet_services.junction_inference.model import Model
from juncnet_services.junction_inference.service import Config as InferenceConfig
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.service import Config as NavigationConfig
from juncnet_services.road_following.follower import load_follower
from juncnet_services.road_following.runner import FollowerRunner, Watchdog
from juncnet_services.road_following.service import Config as FollowingConfig

TOPICS = [t.key for t in (CAMERA_VIDEO, VEHICLE_STATE, JUNCTION_SCORE, ROAD_COMMAND)]
HALF = 0.5
MARGIN = 0.1
STEERING_RADPS = 0.1
"""Yaw rates further apart than this are another decision."""
SHOWN = 20
Key = tuple[int, int]


@dataclass(frozen=True)
class Difference:
    """A frame whose verdict or steering is another one now."""

    sequence: int
    what: str
    recorded: float | None
    present: float | None

    @property
    def change(self) -> str:
        """From what to what, for a person."""
        was, now = ("none" if v is None else f"{v:.3f}" for v in (self.recorded, self.present))
        return f"{was} -> {now}"


@dataclass
class Report:
    """What a check found."""

    frames: int = 0
    compared: int = 0
    largest: float = 0.0
    """Largest difference between the recorded and the present probability."""
    differences: list[Difference] = field(default_factory=list[Difference])
    events: Comparison = field(default_factory=lambda: Comparison((), ()))

    @property
    def same(self) -> bool:
        """Whether every verdict and every event is as recorded."""
        verdicts = any(d.what == "junction" for d in self.differences)
        return self.compared > 0 and not verdicts and self.events.same

    def fields(self) -> dict[str, Any]:
        """Return the report as JSON has it."""
        return {
            "same": self.same,
            "frames": self.frames,
            "compared": self.compared,
            "largest_probability_difference": self.largest,
            "differences": [vars(d) for d in self.differences],
            "events": self.events.fields(),
        }

    def text(self) -> str:
        """Return the report for a person."""
        rows = [
            f"{self.frames} frames, {self.compared} of them with a recorded score; the probability "
            f"differs by {self.largest:.3f} at most"
        ]
        for what in ("junction", "steering"):
            found = [d for d in self.differences if d.what == what]
            rows.append(f"{what}: {len(found)} frames are decided differently")
            rows += [f"  frame {d.sequence}: {d.change}" for d in found[:SHOWN]]
            rows += [f"  and {len(found) - SHOWN} more"] if len(found) > SHOWN else []
        return "\n".join([*rows, self.events.text()])


class Cores:
    """The present cores of the services that a replay goes through."""

    def __init__(self, layout: Layout, recording: Recording) -> None:
        inference = layout.section("junction_inference", InferenceConfig)
        following = layout.section("road_following", FollowingConfig)
        navigation = layout.section("junction_navigation", NavigationConfig)
        self.model = Model(asset_path(inference.model, "models", ".onnx"))
        self.extractor = Extractor(self.model.preprocessing)
        follower = load_follower(following.follower, following.options, following.camera)
        watchdog = Watchdog(60.0, following.follower)
        self.errors: list[str] = []
        self.runner = FollowerRunner(follower, following.source, watchdog, self.errors.append)
        states = (item.message for item in recording.messages([NAVIGATION_STATE.key]))
        first: NavigationState | None = next(states, None)
        if first is None:
            raise RecordingError(f"{recording.files[0]}: it holds no mission")
        self.navigator = Navigator(navigation, first.mission, "check")


def check(recording: Recording, settings: Sequence[str]) -> Report:
    """Return what the present code decides differently.

    Raises:
        RecordingError: the recording lacks what a check needs.
    """
    with TemporaryDirectory(prefix="jn-") as folder:
        cores = Cores(recorded_layout(recording, Path(folder), settings), recording)
    report = Report()
    scores: dict[Key, JunctionScore] = {}
    roads: dict[Key, RoadCommand] = {}
    for item in recording.messages([JUNCTION_SCORE.key, ROAD_COMMAND.key]):
        kept: dict[Key, Any] = scores if item.topic.key == JUNCTION_SCORE.key else roads
        kept[_key(item.message.header)] = item.message
    happened: list[Happened] = []
    for header, score, road, decision in _decisions(cores, recording):
        report.frames += 1
        _compare(report, header, scores.get(_key(header)), score)
        _compare_steering(report, header, roads.get(_key(header)), road)
        for event in decision.events:
            cores.runner.heard(event)
            happened.append(Happened.of(event))
    was = tuple(Happened.of(event) for event in recorded_events(recording))
    report.events = Comparison(was, tuple(happened))
    return report


def _decisions(
    cores: Cores, recording: Recording
) -> Iterator[tuple[Stamp, JunctionScore, RoadCommand, Any]]:
    """Yield header, score, road and decision of every recorded picture, at its own time."""
    decoder = VideoDecoder()
    vehicle: VehicleState | None = None
    for item in recording.messages(TOPICS[:2]):
        if item.topic.key == VEHICLE_STATE.key:
            vehicle = item.message
            continue
        for frame in decoder.decode(item.message):
            (score,) = cores.model.scores([frame.header], [cores.extractor(frame.luminance())])
            road = cores.runner.command(frame, vehicle)
            now = Instant(_came_ns(recording, item), frame.header.clock)
            yield frame.header, score, road, cores.navigator.step(now, score, road, vehicle)


def _came_ns(recording: Recording, item: Recorded) -> int:
    return item.time_ns - int(recording.metadata["wall_minus_clock_ns"])


def _key(header: Stamp) -> Key:
    return header.epoch, header.sequence


def _compare(
    report: Report, header: Stamp, recorded: JunctionScore | None, present: JunctionScore
) -> None:
    if recorded is None:
        return
    report.compared += 1
    was, now = recorded.junction, present.junction
    report.largest = max(report.largest, abs(was - now))
    if (was >= HALF) != (now >= HALF) and abs(was - now) > MARGIN:
        report.differences.append(Difference(header.sequence, "junction", was, now))


def _compare_steering(
    report: Report, header: Stamp, recorded: RoadCommand | None, present: RoadCommand
) -> None:
    if recorded is None:
        return
    was = None if recorded.velocity is None else recorded.velocity.yaw_rate_radps
    now = None if present.velocity is None else present.velocity.yaw_rate_radps
    far = was is None or now is None or abs(was - now) > STEERING_RADPS
    if far and was != now:
        report.differences.append(Difference(header.sequence, "steering", was, now))
