"""Every kind of camera: which configuration opens which.

Each is imported when it is configured, so a drone's computer needs the libraries of its own only.
"""

import time

from juncnet.bus import Bus
from juncnet.topics import SIMULATOR_CAMERA
from juncnet_services.frame_capture.contract import Camera, CameraError
from juncnet_services.frame_capture.live import LiveCamera
from juncnet_services.frame_capture.sources import (
    DeviceSource,
    FileSource,
    FolderSource,
    RemoteSource,
    RtpSource,
    SimulatedSource,
    Source,
    StreamSource,
)


def open_camera(source: Source, bus: Bus, *, decode: bool) -> Camera:
    """Return the camera of `source`; without `decode` it gives access units only.

    Raises:
        CameraError: it is a recording that cannot be read, or its library is not installed. Live
            cameras retry instead.
    """
    try:
        return _open(source, bus, decode=decode)
    except ImportError as error:
        raise CameraError(
            f"source.kind {source.kind!r} needs {error.name}, which is not installed: install "
            "juncnet[laptop]; or forward H.264 from kind 'rtp', or from an rtsp:// URL, with "
            "decode = false, which needs nothing"
        ) from error


def _open(source: Source, bus: Bus, *, decode: bool) -> Camera:
    match source:
        case SimulatedSource():
            from juncnet_services.frame_capture.simulated import SimulatedCamera

            return SimulatedCamera(bus.frames_in(SIMULATOR_CAMERA))
        case RemoteSource():
            from juncnet_services.frame_capture.remote import RemoteCamera

            return RemoteCamera(bus, source.stall_s)
        case FileSource():
            from juncnet_services.frame_capture.file import FileCamera

            return FileCamera(source, bus.clock, time.sleep, decode=decode)
        case FolderSource():
            from juncnet_services.frame_capture.folder import FolderCamera

            return FolderCamera(source, bus.clock, time.sleep)
        case DeviceSource():
            from juncnet_services.frame_capture.v4l2 import device_connector

            return LiveCamera(device_connector(source, bus.clock, decode=decode))
        case RtpSource() if not decode:
            from juncnet_services.frame_capture.rtp_camera import RtpReceiver

            receiver = RtpReceiver(source, bus.clock)
            return LiveCamera(receiver.connect, receiver.ask_key_frame)
        case StreamSource() if not decode and source.url.startswith("rtsp://"):
            from juncnet_services.frame_capture.rtsp import RtspReceiver

            return LiveCamera(RtspReceiver(source, bus.clock).connect)
        case StreamSource() | RtpSource():
            from juncnet_services.frame_capture.stream import stream_connector

            return LiveCamera(stream_connector(source, bus.clock, decode=decode))
