"""A camera on this host: a Video4Linux2 device, through FFmpeg."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import av
from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import Clock
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.live import Arrival, Connect
from juncnet_services.frame_capture.stream import explained, read


class DeviceSource(BaseModel):
    """A V4L2 device."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["v4l2"]
    device: Path = Field(default=Path("/dev/video0"), description="The device file.")
    width: int = Field(default=1920, ge=2, le=16384, description="Asked of the device [px].")
    height: int = Field(default=1080, ge=2, le=16384, description="Asked of the device [px].")
    fps: float = Field(default=25.0, gt=0, le=1000, description="Asked of the device.")
    input_format: str | None = Field(
        default=None, description="FFmpeg's name of what to ask for: mjpeg, h264, yuyv422, nv12."
    )
    stall_s: float = Field(
        default=2.0, gt=0, le=120, description="A device silent for so long is opened again."
    )


def device_connector(source: DeviceSource, clock: Clock, *, decode: bool) -> Connect:
    """Return what opens the device for a `LiveCamera`."""

    @contextmanager
    def connect(counts: Counts) -> Generator[Iterator[Arrival]]:
        if not source.device.exists():
            raise CameraError(
                f"no camera device {source.device}: plug it in, or correct source.device "
                "(`ls /dev/video*` lists those present)"
            )
        options = {
            "video_size": f"{source.width}x{source.height}",
            "framerate": f"{source.fps:g}",
            **({"input_format": source.input_format} if source.input_format else {}),
        }
        check = (
            "is it a camera, free, readable by this user (group video), and does it offer this "
            "size, rate and format (`v4l2-ctl --list-formats-ext`)?"
        )
        timeout = (source.stall_s + 10.0, source.stall_s)
        with (
            explained(str(source.device), check),
            av.open(
                str(source.device), format="v4l2", options=options, timeout=timeout
            ) as container,
        ):
            yield read(container, counts, clock, decode=decode)

    return connect
