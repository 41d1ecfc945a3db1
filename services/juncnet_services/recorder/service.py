"""recorder: every topic of the robot -> MCAP files.

It only listens: a recorder that is slow, killed or out of disk changes nothing in flight. After a
kill at most the last second is missing, and the next recorder completes the file.
"""

from contextlib import closing
from pathlib import Path

from pydantic import Field

from juncnet.bus import Bus
from juncnet.launch import launch
from juncnet.priority import give_way
from juncnet.topics import CAMERA_FRAME, CAMERA_VIDEO
from juncnet_services.recorder.disk import DiskWatch
from juncnet_services.recorder.ears import Ears
from juncnet_services.recorder.pictures import Pictures, VideoOptions
from juncnet_services.recorder.session import Limits, begin

NICENESS = 15
"""The flight comes first, then the dashboard."""
TICK_S = 0.05
MB = 1_000_000


class Config(VideoOptions):
    """Options of the recorder."""

    folder: Path = Field(default=Path("recordings"), description="Where the files go.")
    split_mb: int = Field(default=1000, ge=1, description="A new file begins after this size.")
    warn_free_mb: int = Field(default=2000, ge=0, description="Free disk that is nearly full.")
    stop_free_mb: int = Field(default=300, ge=0, description="Free disk at which recording ends.")
    video: bool = Field(
        default=True,
        description="Encode camera/frame as H.264 while the camera itself gives no camera/video.",
    )
    features: bool = Field(
        default=False,
        description="Record radon/features too, 0.8 MB/s; they follow from the pictures.",
    )


def run(bus: Bus, config: Config) -> None:
    """Record until the bus stops or the disk is full.

    Raises:
        OSError: the folder cannot be written.
    """
    limits = Limits(config.split_mb * MB, config.warn_free_mb * MB, config.stop_free_mb * MB)
    session = begin(bus, config.folder, limits)
    pictures = Pictures(bus.frames_in(CAMERA_FRAME) if config.video else None, config)
    with closing(session):
        ears, disk = Ears(bus, config.features), DiskWatch(session, bus.health)
        while (bus.running or pictures.busy) and disk.has_room(bus.clock.now_ns()):
            packets = pictures.next(bus.clock.now_ns(), TICK_S)
            if not config.video:
                bus.wait(TICK_S)
            began_ns, heard = bus.clock.now_ns(), list(ears.heard())
            if any(topic is CAMERA_VIDEO for _, topic, _ in heard):
                pictures.camera_gave(began_ns)
            own = [(bus.robot, CAMERA_VIDEO, packet) for packet in packets]
            for robot, topic, message in [*own, *heard]:
                if session.write(robot, topic, message):
                    pictures.restart()  # a new file: its video begins with a key frame
                if topic is CAMERA_VIDEO:
                    bus.health.output(began_ns, None)


def main() -> None:
    """Start the process."""
    give_way(NICENESS)
    launch(run, Config)
