"""dashboard: every topic of a robot, a browser's orders -> one page, command/override, requests.

Optional: nothing in flight waits for it or asks it anything. Its address, with the keys to watch
and to command, is in `dashboard.json` in the flight directory and in its log.
"""

import logging
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from juncnet.bus import Bus
from juncnet.camera import CameraGeometry
from juncnet.launch import launch
from juncnet_services.dashboard.access import Right, address_in
from juncnet_services.dashboard.board import Board, listen
from juncnet_services.dashboard.pages import About, served

DASHBOARD = "dashboard"
"""Name of the process and of its section in a layout."""


class Config(BaseModel):
    """Options of the dashboard."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    port: int = Field(default=0, ge=0, le=65535)
    """On the loopback interface; 0: any free one, kept through restarts within a flight."""
    view_only: bool = False
    """Whether the page can only look: the key that commands is not given out and not accepted."""
    camera: CameraGeometry = CameraGeometry()
    """Where the camera is: the road is drawn into its picture."""
    picture_age_s: float = Field(default=0.2, gt=0, le=5)
    """Age from which a picture is shown as too old to move the robot."""
    picture_rate_hz: float = Field(default=12.5, gt=0, le=60)
    """At most so many pictures a second for a page."""
    followers: tuple[str, ...] = ("juncnet_services.road_following.vision:VisionFollower",)
    """Followers that the page offers; any other can be typed in."""


def about(config: Config, bus: Bus) -> About:
    """Return what the page is told of its dashboard."""
    return About(
        epoch=str(bus.epoch),
        view_only=config.view_only,
        picture_age_s=config.picture_age_s,
        picture_rate_hz=config.picture_rate_hz,
        followers=config.followers,
    )


def page_url(directory: Path, config: Config) -> str:
    """Return the address that the dashboard of this flight directory has or will have."""
    right = Right.WATCH if config.view_only else Right.COMMAND
    return address_in(directory, config.port).url(right)


def run(bus: Bus, config: Config) -> None:
    """Serve the page until the bus stops."""
    address = address_in(bus.flight_dir, config.port)
    board = Board(bus.clock, config.camera)
    with served(board, address, about(config, bus)):
        logging.getLogger(bus.service).info("%s", page_url(bus.flight_dir, config))
        listen(bus, board)


def main() -> None:
    """Start the process."""
    launch(run, Config)
