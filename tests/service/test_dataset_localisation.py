"""Telling junctions apart: a model of three classes, and events that carry its label."""

# onnx leaves some of its own members without types.
# pyright: reportUnknownMemberType=false

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from fakes import FakeBus
from juncnet import topics
from juncnet.features import Preprocessing
from juncnet.messages import (
    Capabilities,
    EventKind,
    Features,
    JunctionScore,
    Mission,
    Output,
    RoadCommand,
    Stamp,
    VehicleState,
    Velocity,
)
from juncnet_services.cli.view import event_text
from juncnet_services.junction_inference import service as inference
from juncnet_services.junction_navigation import service as navigation
from scenes import tiny_model

CLASSES = ("none", "junction_1", "junction_2")
BOTH = Preprocessing(channels=("gray", "radon"))
COPTER = Capabilities(kind="copter", turns_in_place=True, telemetry=True)
Step = Callable[[FakeBus], None]


def three_class_model(path: Path) -> Path:
    """Write a model: a bright first channel is junction_1, a bright second one junction_2."""
    tiny_model(path, preprocessing=BOTH, classes=CLASSES)
    model = onnx.load(str(path))
    weights = np.array([[0, 8, 0], [0, 0, 8]], np.float32)
    for tensor in model.graph.initializer:
        if tensor.name == "weights":
            tensor.CopyFrom(numpy_helper.from_array(weights, "weights"))
    onnx.save(model, str(path))
    return path


def scores(path: Path, levels: list[tuple[float, float]]) -> list[JunctionScore]:
    """Return what junction_inference says to features of these levels of the two channels."""
    script: list[tuple[topics.Topic[Features], Features]] = []
    for second, (gray, radon) in enumerate(levels, 1):
        array = np.stack([np.full((64, 64), gray), np.full((64, 64), radon)]).astype(np.float32)
        header = Stamp(epoch=1, sequence=second, time_ns=second * 10**9, clock="c")
        message = Features.from_array(array, header, BOTH.hash)
        script.append((topics.RADON_FEATURES, message))
    bus = FakeBus(script)
    inference.run(bus, inference.Config(model=str(path)))
    (active,) = bus.published[topics.MODEL_ACTIVE.key]
    assert active.classes == CLASSES
    return bus.published[topics.JUNCTION_SCORE.key]


def frame(sequence: int, said: JunctionScore) -> Step:
    """The three inputs that one picture brings, 40 ms after the last."""

    def deliver(bus: FakeBus) -> None:
        bus.clock.advance(0.04)
        now = Stamp(epoch=1, sequence=sequence, time_ns=bus.clock.ns, clock=bus.clock.id)
        forward = Velocity(forward_mps=3.0)
        state = VehicleState(
            at=now, capabilities=COPTER, yaw_rad=0.0, velocity=forward, output=Output.PIPELINE
        )
        road = RoadCommand(header=now, source="road_following", velocity=forward, confidence=0.9)
        score = said.model_copy(update={"header": now})
        for topic, message in (
            (topics.VEHICLE_STATE, state),
            (topics.ROAD_COMMAND, road),
            (topics.JUNCTION_SCORE, score),
        ):
            for inbox in bus._inboxes[topic.key]:  # pyright: ignore[reportPrivateUsage]  (fake)
                inbox.put(bus.robot, message)

    return deliver


def test_scores_name_the_likeliest_junction_and_sum_over_all(tmp_path: Path) -> None:
    none, first, second = scores(three_class_model(tmp_path / "m.onnx"), [(0, 0), (1, 0), (0, 1)])
    assert [s.label for s in (first, second)] == ["junction_1", "junction_2"]
    assert none.junction < 0.1
    assert first.junction > 0.95
    assert second.probabilities.keys() == set(CLASSES)


def test_events_carry_the_label_of_their_junction(tmp_path: Path) -> None:
    none, first, second = scores(three_class_model(tmp_path / "m.onnx"), [(0, 0), (1, 0), (0, 1)])
    ahead = [(none, 30), (first, 95), (none, 205), (second, 95), (none, 200)]
    said = [score for score, frames in ahead for _ in range(frames)]
    script = [step for n, score in enumerate(said, 1) for step in (frame(n, score), 0.001)]
    bus = FakeBus(script, directory=tmp_path)
    navigation.run(bus, navigation.Config(mission=Mission(finish_after=2)))
    events = bus.published[topics.JUNCTION_EVENT.key]
    by_count = {count: {(e.kind, e.label) for e in events if e.count == count} for count in (1, 2)}
    for count, label in ((1, "junction_1"), (2, "junction_2")):
        for kind in (EventKind.APPROACHED, EventKind.ENTERED, EventKind.LEFT):
            assert (kind, label) in by_count[count]
    approached = [e for e in events if e.kind is EventKind.APPROACHED]
    assert [e.count for e in approached] == [1, 2]
    assert event_text(approached[1]).endswith("junction 2 (junction_2)")
