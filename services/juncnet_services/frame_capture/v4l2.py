"""A camera on this host: a Video4Linux2 device, through FFmpeg."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager

import av

from juncnet.clocks import Clock
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.live import Arrival, Connect
from juncnet_services.frame_capture.sources import DeviceSource
from juncnet_services.frame_capture.stream import explained, read


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
