"""Every kind of camera: which configuration opens which."""

import time
from typing import Annotated

from pydantic import Field

from juncnet.bus import Bus
from juncnet.topics import SIMULATOR_CAMERA
from juncnet_services.frame_capture.contract import Camera
from juncnet_services.frame_capture.file import FileCamera, FileSource
from juncnet_services.frame_capture.folder import FolderCamera, FolderSource
from juncnet_services.frame_capture.live import LiveCamera
from juncnet_services.frame_capture.simulated import SimulatedCamera, SimulatedSource
from juncnet_services.frame_capture.stream import RtpSource, StreamSource, stream_connector
from juncnet_services.frame_capture.v4l2 import DeviceSource, device_connector

Source = Annotated[
    SimulatedSource | FileSource | FolderSource | DeviceSource | StreamSource | RtpSource,
    Field(discriminator="kind"),
]
"""The camera of the configuration, by its `kind`."""


def open_camera(source: Source, bus: Bus, *, decode: bool) -> Camera:
    """Return the camera of `source`; without `decode` it gives access units only.

    Raises:
        CameraError: it is a recording that cannot be read. Live cameras retry instead.
    """
    match source:
        case SimulatedSource():
            return SimulatedCamera(bus.frames_in(SIMULATOR_CAMERA))
        case FileSource():
            return FileCamera(source, bus.clock, time.sleep, decode=decode)
        case FolderSource():
            return FolderCamera(source, bus.clock, time.sleep)
        case DeviceSource():
            return LiveCamera(device_connector(source, bus.clock, decode=decode))
        case StreamSource() | RtpSource():
            return LiveCamera(stream_connector(source, bus.clock, decode=decode))
