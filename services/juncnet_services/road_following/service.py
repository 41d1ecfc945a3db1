"""road_following: camera/frame, vehicle/state, junction/event, follower/load -> road/command.

Asks the configured follower, the user's or the built-in one, for a velocity in each picture.
Another one takes its place on request, until the process ends; follower/active says which it is.
"""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from juncnet.bus import Bus
from juncnet.camera import CameraGeometry
from juncnet.launch import launch
from juncnet.messages import ActiveFollower, LoadFollower, Name, Reply
from juncnet.topics import (
    CAMERA_FRAME,
    FOLLOWER_ACTIVE,
    FOLLOWER_LOAD,
    JUNCTION_EVENT,
    ROAD_COMMAND,
    VEHICLE_STATE,
)
from juncnet_services.road_following.follower import FollowerError, load_follower
from juncnet_services.road_following.runner import FollowerRunner, Watchdog


class Config(BaseModel):
    """Options of `road_following`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    follower: str = "juncnet_services.road_following.vision:VisionFollower"
    """The follower's class as `package.module:Class`, from this package or any installed one."""
    options: dict[str, Any] = Field(default_factory=dict)
    """The follower's own options; it validates them."""
    camera: CameraGeometry | None = None
    """Where the camera is, for a follower that has an option of this name."""
    source: Name = "road_following"
    """Name under which the proposals are published; the navigator obeys one source only."""
    time_limit_s: float = Field(default=0.5, gt=0, le=60)
    """A call of the follower that takes longer ends the process, and the supervisor restarts it."""


def run(bus: Bus, config: Config) -> None:
    """Publish a proposal for every newest picture until the bus stops."""
    follower = load_follower(config.follower, config.options, config.camera)
    watchdog = Watchdog(config.time_limit_s, config.follower)
    runner = FollowerRunner(follower, config.source, watchdog, bus.health.error)
    bus.publish(FOLLOWER_ACTIVE, ActiveFollower(follower=config.follower))

    def load(request: LoadFollower) -> Reply:
        own = request.follower == config.follower and not request.options
        options = config.options if own else request.options
        try:
            runner.swap(load_follower(request.follower, options, config.camera))
        except FollowerError as error:
            return Reply(accepted=False, reason=f"{error}; the follower before stays")
        bus.publish(FOLLOWER_ACTIVE, ActiveFollower(follower=request.follower))
        return Reply(accepted=True)

    bus.serve(FOLLOWER_LOAD, load)
    frames = bus.frames_in(CAMERA_FRAME)
    states = bus.subscribe(VEHICLE_STATE, wakes=False)
    events = bus.subscribe(JUNCTION_EVENT, capacity=16)
    while bus.running:
        with frames.take(0.2) as frame:
            taken_ns = bus.clock.now_ns()
            states.drain()
            for _, event in events.drain():
                runner.heard(event)
            if frame is not None:
                bus.publish(ROAD_COMMAND, runner.command(frame, states.newest))
                bus.health.output(taken_ns, frame.header)


def main() -> None:
    """Start the process."""
    launch(run, Config)
