"""THE table of topics: one line a topic. Keys are `juncnet/<robot>/<key>`.

Nothing else declares a key; whoever publishes or subscribes names a topic of this table.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Generic, TypeVar, cast

from juncnet import messages as m
from juncnet.messages import Message, MessageError

ROOT = "juncnet"
M = TypeVar("M", bound=Message)


class Qos(StrEnum):
    """How a topic travels; `juncnet.bus` maps it to Zenoh."""

    COMMAND = "command"
    """Real-time priority, express, dropped rather than queued."""
    FLIGHT = "flight"
    """High priority, dropped rather than queued: the newest counts."""
    EVENT = "event"
    """Advanced publisher: late joiners get the history, missed samples are found."""
    KEPT = "kept"
    """Advanced publisher: late joiners get the newest."""
    BULK = "bulk"
    """Lowest priority, dropped first."""


@dataclass(frozen=True)
class Topic(Generic[M]):
    """One topic: `key` below the robot, what travels, how, from whom, how often (0: at events)."""

    key: str
    message: type[M]
    publisher: str
    rate_hz: float
    qos: Qos

    def expression(self, robot: str) -> str:
        """Return the Zenoh key expression for `robot` (`*`: every robot)."""
        return f"{ROOT}/{robot}/{self.key}"

    def robot_of(self, key: str) -> str:
        """Return the robot that a message under `key` is of.

        Raises:
            MessageError: it was published to many keys at once, with wildcards.
        """
        if "*" in key:
            raise MessageError(f"{self.key}: published with wildcards, to whomever it may concern")
        return key.split("/")[1]


@dataclass(frozen=True)
class Request(Generic[M]):
    """A request, answered with a `juncnet.messages.Reply` by the one service that serves it."""

    key: str
    message: type[M]
    server: str

    def expression(self, robot: str) -> str:
        """Return the Zenoh key expression for `robot`."""
        return f"{ROOT}/{robot}/{self.key}"


@dataclass(frozen=True)
class FrameTopic:
    """Raw pictures for consumers on this host (`juncnet.frames`); never over a network."""

    key: str
    publisher: str
    rate_hz: float

    def expression(self, robot: str) -> str:
        """Return the Zenoh key expression for `robot`."""
        return f"{ROOT}/{robot}/{self.key}"


# fmt: off
CAMERA_FRAME     = FrameTopic("camera/frame", "frame_capture", 25)
CAMERA_IMAGE     = Topic("camera/image", m.JpegImage, "frame_capture", 12.5, Qos.BULK)
CAMERA_VIDEO     = Topic("camera/video", m.VideoPacket, "frame_capture", 25, Qos.BULK)
CAMERA_KEY_FRAME = Topic("camera/key_frame", m.KeyFrameRequest, "frame_capture", 0, Qos.FLIGHT)
RADON_FEATURES   = Topic("radon/features", m.Features, "radon_preprocessing", 25, Qos.FLIGHT)
JUNCTION_SCORE   = Topic("junction/score", m.JunctionScore, "junction_inference", 25, Qos.FLIGHT)
MODEL_ACTIVE     = Topic("model/active", m.ActiveModel, "junction_inference", 0, Qos.KEPT)
MODEL_LOAD       = Request("model/load", m.LoadModel, "junction_inference")
FOLLOWER_ACTIVE  = Topic("follower/active", m.ActiveFollower, "road_following", 0, Qos.KEPT)
FOLLOWER_LOAD    = Request("follower/load", m.LoadFollower, "road_following")
ROAD_COMMAND     = Topic("road/command", m.RoadCommand, "road_following", 25, Qos.FLIGHT)
JUNCTION_EVENT   = Topic("junction/event", m.JunctionEvent, "junction_navigation", 0, Qos.EVENT)
NAVIGATION_STATE = Topic("navigation/state", m.NavigationState, "junction_navigation", 25, Qos.KEPT)
MISSION_SET      = Request("mission/set", m.SetMission, "junction_navigation")
COMMAND_VELOCITY = Topic("command/velocity", m.VelocityCommand, "junction_navigation", 25, Qos.COMMAND)  # noqa: E501
COMMAND_OVERRIDE = Topic("command/override", m.Override, "operator", 0, Qos.COMMAND)
COMMAND_ACK      = Topic("command/ack", m.Ack, "command_output", 0, Qos.EVENT)
VEHICLE_STATE    = Topic("vehicle/state", m.VehicleState, "command_output", 25, Qos.FLIGHT)
SIMULATOR_CAMERA = FrameTopic("simulator/camera", "simulator", 25)
SIMULATOR_TRUTH  = Topic("simulator/truth", m.SimulatorTruth, "simulator", 25, Qos.FLIGHT)
# fmt: on

SERVICES = (
    "frame_capture",
    "radon_preprocessing",
    "junction_inference",
    "road_following",
    "junction_navigation",
    "command_output",
)
"""The six services, in data order."""


def health_topic(service: str) -> Topic[m.Health]:
    """Return the health topic of `service` (`*`: of every process)."""
    return Topic(f"health/{service}", m.Health, service, 1, Qos.FLIGHT)


def clock_key(robot: str, clock: str) -> str:
    """Return the key under which a host's processes tell the `ClockReading` of its `clock`."""
    return f"{ROOT}/{robot}/clock/{clock}"


TOPICS: tuple[Topic[Any] | Request[Any] | FrameTopic, ...] = tuple(
    cast(Any, value)
    for value in list(globals().values())
    if isinstance(value, (Topic, Request, FrameTopic))
)
