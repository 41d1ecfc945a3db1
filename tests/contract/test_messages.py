"""Every message round-trips; what is malformed is refused with the name of the field."""

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from juncnet import messages as m
from juncnet import topics as t
from juncnet.messages import Message, MessageError, Stamp

STAMP = Stamp(epoch=1, sequence=2, time_ns=3, clock="boot-1")
SHA = "0" * 64
MODEL = m.ModelIdentity(name="paper", sha256=SHA)
STATE: dict[str, Any] = {"flight": "f1", "count": 0, "mission": m.Mission(), "next_turn": None}
FEATURES = m.Features.from_array(np.ones((2, 64, 64), np.float32), STAMP, SHA)

EXAMPLES: dict[str, Message] = {
    "camera/image": m.JpegImage.of(b"\xff\xd8..", header=STAMP, width=4, height=2),
    "camera/key_frame": m.KeyFrameRequest(at=STAMP),
    "camera/video": m.VideoPacket.of(b"\0\0\0\1", header=STAMP, key_frame=True),
    "radon/features": FEATURES,
    "junction/score": m.JunctionScore(
        header=STAMP, model=MODEL, probabilities={"none": 0.25, "junction": 0.75}
    ),
    "model/active": m.ActiveModel(
        model=MODEL, classes=("none", "junction"), preprocessing="{}", preprocessing_hash=SHA
    ),
    "model/load": m.LoadModel(path="/models/a.onnx"),
    "follower/active": m.ActiveFollower(follower="package.module:Class"),
    "follower/load": m.LoadFollower(follower="a.b:C", options={"speed_mps": 1.5}),
    "road/command": m.RoadCommand(
        header=STAMP,
        source="vision",
        velocity=m.Velocity(forward_mps=3),
        confidence=0.9,
        road=m.RoadSeen(offset_m=0.1, heading_rad=0.0, width_m=5, centre=((1.0, 0.0),)),
    ),
    "junction/event": m.JunctionEvent(
        header=STAMP,
        flight="f1",
        index=0,
        kind=m.EventKind.APPROACHED,
        count=1,
        probability=0.9,
        turn=m.Turn(at=1, turn="left"),
    ),
    "navigation/state": m.NavigationState(header=None, phase=m.Phase.WAITING, **STATE),
    "mission/set": m.SetMission(mission=m.Mission(turns=(m.Turn(at=3, angle_deg=45),))),
    "command/velocity": m.VelocityCommand(header=STAMP, issued=STAMP, velocity=m.Velocity()),
    "command/override": m.Override(issued=STAMP, kind=m.OverrideKind.HOLD),
    "command/ack": m.Ack(override=STAMP, kind=m.OverrideKind.HOLD, accepted=True, at=STAMP),
    "vehicle/state": m.VehicleState(
        at=STAMP, capabilities=m.Capabilities(), output=m.Output.HOLD, yaw_rad=0.5
    ),
    "simulator/truth": m.SimulatorTruth(
        at=STAMP,
        header=STAMP,
        pose=m.Pose(x_m=1, y_m=2),
        velocity=m.Velocity(),
        road_offset_m=0.1,
        off_road_m=0,
        collided=False,
        junction_id=None,
        junctions_passed=2,
        path=(1, 2),
        label="none",
        mouth_m=None,
        real_time_factor=1.0,
        simulated_s=12.0,
    ),
}
CARRIERS = [topic for topic in t.TOPICS if not isinstance(topic, t.FrameTopic)]


@pytest.mark.parametrize("topic", CARRIERS, ids=lambda topic: topic.key)
def test_every_message_round_trips(topic: t.Topic[Any] | t.Request[Any]) -> None:
    example = EXAMPLES[topic.key]
    assert type(example) is topic.message
    decoded = topic.message.decode(*example.encode())
    assert decoded == example
    assert decoded.encode() == example.encode()


@pytest.mark.parametrize("topic", CARRIERS, ids=lambda topic: topic.key)
def test_unknown_fields_and_wrong_types_are_refused(topic: t.Topic[Any] | t.Request[Any]) -> None:
    payload, attachment = EXAMPLES[topic.key].encode()
    fields = json.loads(attachment or payload)
    for broken in (fields | {"surplus": 1}, [fields], None):
        text = json.dumps(broken).encode()
        with pytest.raises(MessageError, match=topic.message.__name__):
            topic.message.decode(*((payload, text) if attachment else (text, None)))


def _with(message: Message, **changes: Any) -> tuple[type[Message], bytes]:
    return type(message), json.dumps(json.loads(message.model_dump_json()) | changes).encode()


REFUSED = {
    "JunctionScore.probabilities": _with(
        EXAMPLES["junction/score"], probabilities={"none": 0.5, "junction": 0.6}
    ),
    "RoadCommand.confidence": _with(EXAMPLES["road/command"], confidence=1.1),
    "VelocityCommand.velocity.forward_mps": _with(
        EXAMPLES["command/velocity"], velocity={"forward_mps": float("nan")}
    ),
    "VelocityCommand.header": _with(EXAMPLES["command/velocity"], header={"epoch": 1}),
    "VelocityCommand.issued: time_ns": _with(
        EXAMPLES["command/velocity"], issued=asdict(STAMP) | {"time_ns": -1}
    ),
    "VelocityCommand.issued.surplus": _with(
        EXAMPLES["command/velocity"], issued=asdict(STAMP) | {"surplus": 1}
    ),
    "Override": _with(EXAMPLES["command/override"], kind="manual"),
    "SetMission.mission.turns.0": _with(EXAMPLES["mission/set"], mission={"turns": [{"at": 1}]}),
    "SetMission.mission": _with(
        EXAMPLES["mission/set"],
        mission={"turns": [{"at": 2, "turn": "left"}], "finish_after": 1},
    ),
}


@pytest.mark.parametrize("where", REFUSED)
def test_refusals_name_the_field(where: str) -> None:
    kind, payload = REFUSED[where]
    with pytest.raises(MessageError, match=rf"^{where}"):
        kind.decode(payload)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *((f, v) for f in ("epoch", "sequence", "time_ns", "uncertainty_ns") for v in (-1, 2**63)),
        *(("clock", v) for v in ("", "a" * 129, "boot 1", "boot-1\n", "\u00fcber")),
    ],
)
def test_a_stamp_refuses_what_it_cannot_be(field: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^{field}: "):
        replace(STAMP, **{field: value})


def test_features_check_shape_dtype_and_values() -> None:
    payload, attachment = FEATURES.encode()
    np.testing.assert_array_equal(FEATURES.array, np.ones((2, 64, 64), np.float32))
    with pytest.raises(MessageError, match=r"Features\.payload: .* bytes"):
        m.Features.decode(payload[:-4], attachment)
    with pytest.raises(MessageError, match=r"Features\.payload: contains NaN"):
        m.Features.decode(b"\0\0\xc0\x7f" + payload[4:], attachment)
    with pytest.raises(MessageError, match=r"Features\.attachment"):
        m.Features.decode(payload)
    with pytest.raises(MessageError, match=r"Features\.array"):
        m.Features.from_array(np.ones((64, 64), np.float32), STAMP, SHA)


def test_bulk_payloads_must_be_what_they_say() -> None:
    with pytest.raises(MessageError, match=r"JpegImage\.payload"):
        m.JpegImage.of(b"GIF89a", header=STAMP, width=4, height=2)
    with pytest.raises(MessageError, match=r"VideoPacket\.payload"):
        m.VideoPacket.of(b"", header=STAMP, key_frame=False)
