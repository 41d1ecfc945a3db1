"""Every message that travels between processes: units per field, shape and dtype per array."""

from juncnet.messages.base import (
    BulkMessage,
    Message,
    MessageError,
    Metres,
    Name,
    Probability,
    Reply,
    Sha256,
    Stamp,
)
from juncnet.messages.junctions import (
    EventKind,
    JunctionEvent,
    Mission,
    NavigationState,
    Phase,
    SetMission,
    Turn,
)
from juncnet.messages.motion import (
    Ack,
    Override,
    OverrideKind,
    RoadCommand,
    RoadSeen,
    Velocity,
    VelocityCommand,
)
from juncnet.messages.pictures import JpegImage, PixelFormat, VideoPacket
from juncnet.messages.scores import ActiveModel, Features, JunctionScore, LoadModel, ModelIdentity
from juncnet.messages.simulation import SimulatorTruth
from juncnet.messages.vehicle import Capabilities, GeoPoint, Health, Output, Pose, VehicleState

__all__ = [
    "Ack",
    "ActiveModel",
    "BulkMessage",
    "Capabilities",
    "EventKind",
    "Features",
    "GeoPoint",
    "Health",
    "JpegImage",
    "JunctionEvent",
    "JunctionScore",
    "LoadModel",
    "Message",
    "MessageError",
    "Metres",
    "Mission",
    "ModelIdentity",
    "Name",
    "NavigationState",
    "Output",
    "Override",
    "OverrideKind",
    "Phase",
    "PixelFormat",
    "Pose",
    "Probability",
    "Reply",
    "RoadCommand",
    "RoadSeen",
    "SetMission",
    "Sha256",
    "SimulatorTruth",
    "Stamp",
    "Turn",
    "VehicleState",
    "Velocity",
    "VelocityCommand",
    "VideoPacket",
]
