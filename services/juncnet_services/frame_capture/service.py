"""frame_capture: a camera -> camera/frame, camera/image, camera/video.

Of a live camera the newest picture is published and older ones are dropped. At the end of a
recording the service stays alive, says `end_of_file` in its health and publishes nothing more.
"""

from contextlib import closing

from pydantic import BaseModel, ConfigDict, Field

from juncnet.bus import Bus
from juncnet.launch import launch
from juncnet.topics import CAMERA_KEY_FRAME
from juncnet_services.frame_capture.cameras import open_camera
from juncnet_services.frame_capture.contract import CameraError
from juncnet_services.frame_capture.jpeg import JpegOptions
from juncnet_services.frame_capture.output import CameraOutput
from juncnet_services.frame_capture.sources import RemoteSource, SimulatedSource, Source

WAIT_S = 0.2
EXIT_BAD_SOURCE = 2


class Config(BaseModel):
    """Options of frame_capture."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: Source = Field(
        default=SimulatedSource(), description="The camera, by its `kind`; see sources.py."
    )
    decode: bool = Field(
        default=True,
        description="False: forward camera/video only, without decoding (a drone's computer).",
    )
    frozen_limit: int = Field(
        default=5,
        ge=0,
        description="Exact repeats of a live picture that are still published; a camera that is "
        "frozen must not drive a robot. 0: publish all, for encoders that repeat still scenes.",
    )
    exit_at_end: bool = Field(
        default=False, description="End with code 0 at the end of a recording."
    )
    image: JpegOptions = Field(default=JpegOptions(), description="How camera/image is made.")


def run(bus: Bus, config: Config) -> None:
    """Publish the pictures of the configured camera until the bus stops.

    Raises:
        SystemExit: code 2, the recording cannot be read; the log says why.
    """
    remote = isinstance(config.source, RemoteSource)
    wishes = None if remote else bus.subscribe(CAMERA_KEY_FRAME, wakes=False)
    try:
        with (
            closing(open_camera(config.source, bus, decode=config.decode)) as camera,
            closing(CameraOutput(bus, camera, config.image, config.frozen_limit)) as output,
        ):
            while bus.running and not (camera.ended and config.exit_at_end):
                with camera.take(WAIT_S) as picture:
                    if picture is not None:
                        output.show(picture)
                output.forward()
                if wishes is not None and wishes.take() is not None:
                    camera.want_key_frame()
                output.report()
                if camera.ended:
                    bus.wait(WAIT_S)
    except CameraError as error:
        bus.health.error(str(error))
        raise SystemExit(EXIT_BAD_SOURCE) from error


def main() -> None:
    """Start the process."""
    launch(run, Config)
