"""Every kind of camera as it is configured; importing this needs no camera's library."""

from ipaddress import IPv4Address
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from juncnet_services.frame_capture.pacing import Pace


class SimulatedSource(BaseModel):
    """The frames of topic simulator/camera, on this host."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["simulated"] = "simulated"


class FileSource(BaseModel):
    """A video file that FFmpeg reads."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["file"]
    path: Path = Field(description="The video file; relative to the working directory.")
    pace: Pace = Field(
        default=Pace.REALTIME,
        description="realtime: by the file's time stamps; fastest: no waiting.",
    )
    loop: bool = Field(default=False, description="Begin again at the end.")


class FolderSource(BaseModel):
    """The pictures in a folder; other files in it are left alone."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["folder"]
    path: Path = Field(description="The folder; relative to the working directory.")
    fps: float = Field(default=25.0, gt=0, le=1000, description="Pictures a second.")
    pace: Pace = Field(default=Pace.REALTIME, description="fastest: do not wait between pictures.")
    loop: bool = Field(default=False, description="Begin again after the last.")


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


class StreamSource(BaseModel):
    """A stream named by a URL, or described by an SDP file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["stream"]
    url: str = Field(
        min_length=1,
        description="rtsp://host/path, udp://0.0.0.0:port (MPEG-TS), tcp://host:port, or the path "
        "of an .sdp file.",
    )
    format: str | None = Field(
        default=None, description="FFmpeg's name of the container where it cannot guess: h264."
    )
    transport: Literal["tcp", "udp"] = Field(
        default="tcp", description="How RTSP carries its packets: tcp loses none, udp is quicker."
    )
    connect_timeout_s: float = Field(
        default=10.0, gt=0, le=120, description="For the first packets, a key frame included."
    )
    stall_s: float = Field(
        default=2.0, gt=0, le=120, description="A stream silent for so long is reconnected."
    )


class RtpSource(BaseModel):
    """H.264 over RTP to a port of this host, without a session protocol (Parrot: 55004)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["rtp"]
    port: int = Field(ge=1, le=65535, description="UDP port that the camera sends to.")
    address: str = Field(
        default="0.0.0.0", description="Local or multicast address that it sends to."
    )
    sender: IPv4Address | None = Field(
        default=None,
        description="The camera's own IPv4 address: nobody else's packets are taken. None: the "
        "first that sends is the camera until it is silent for `stall_s`.",
    )
    payload: int = Field(default=96, ge=0, le=127, description="RTP payload type.")
    codec: Literal["h264"] = Field(default="h264", description="What the payload is.")
    connect_timeout_s: float = Field(
        default=10.0, gt=0, le=120, description="For the first packets, a key frame included."
    )
    stall_s: float = Field(
        default=2.0, gt=0, le=120, description="A stream silent for so long is reconnected."
    )


class RemoteSource(BaseModel):
    """camera/video of the vehicle, from another host: decoded here, stamped there."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["remote"]
    stall_s: float = Field(
        default=2.0, gt=0, le=120, description="A silence that is reported as an error."
    )


Source = Annotated[
    SimulatedSource
    | FileSource
    | FolderSource
    | DeviceSource
    | StreamSource
    | RtpSource
    | RemoteSource,
    Field(discriminator="kind"),
]
"""The camera of the configuration, by its `kind`."""
