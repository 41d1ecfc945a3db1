"""Live H.264 over a network: RTSP, RTP, MPEG-TS or raw H.264 over UDP or TCP, through PyAV."""

import io
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import av
from av.container import InputContainer
from av.error import ExitError, FFmpegError
from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import Clock
from juncnet.messages import MessageError
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.decoding import Decoder
from juncnet_services.frame_capture.live import Arrival, Connect
from juncnet_services.frame_capture.planes import picture_of

LOW_LATENCY = {
    "fflags": "nobuffer",
    "flags": "low_delay",
    "fpsprobesize": "0",
    "probesize": "1000000",
    "analyzeduration": "1000000",
    "max_delay": "100000",
}
"""FFmpeg options of every stream; `max_delay` (in us) bounds the wait for reordered packets."""
PROTOCOLS = "file,crypto,data,rtp,udp,tcp,rtsp,tls,http,https"


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
    payload: int = Field(default=96, ge=0, le=127, description="RTP payload type.")
    codec: Literal["h264"] = Field(default="h264", description="What the payload is.")
    connect_timeout_s: float = Field(
        default=10.0, gt=0, le=120, description="For the first packets, a key frame included."
    )
    stall_s: float = Field(
        default=2.0, gt=0, le=120, description="A stream silent for so long is reconnected."
    )


def make_sdp(source: RtpSource) -> str:
    """Return the session description (RFC 8866) of an RTP source."""
    return (
        "v=0\r\n"
        f"o=- 0 0 IN IP4 {source.address}\r\n"
        "s=camera\r\n"
        f"c=IN IP4 {source.address}\r\n"
        "t=0 0\r\n"
        f"m=video {source.port} RTP/AVP {source.payload}\r\n"
        f"a=rtpmap:{source.payload} {source.codec.upper()}/90000\r\n"
        f"a=fmtp:{source.payload} packetization-mode=1\r\n"
    )


def stream_connector(source: StreamSource | RtpSource, clock: Clock, *, decode: bool) -> Connect:
    """Return what opens `source` for a `LiveCamera`."""

    @contextmanager
    def connect(counts: Counts) -> Generator[Iterator[Arrival]]:
        with explained(source_name(source), advice(source)), open_stream(source) as container:
            yield read(container, counts, clock, decode=decode)

    return connect


def source_name(source: StreamSource | RtpSource) -> str:
    """Return how messages name the source."""
    return source.url if isinstance(source, StreamSource) else f"RTP port {source.port}"


def advice(source: StreamSource | RtpSource) -> str:
    """Return what to check when the source gives nothing."""
    if isinstance(source, RtpSource):
        return (
            f"is the camera sending H.264 as RTP payload {source.payload} to UDP port "
            f"{source.port} of this host, does a firewall drop it, has another process the port?"
        )
    if source.url.endswith(".sdp"):
        return "does the SDP file exist and name the codec, address and port that the camera uses?"
    return "is the camera on and reachable, and are address, port, path and password right?"


@contextmanager
def explained(name: str, what_to_check: str) -> Generator[None]:
    """Turn whatever the stream's library raises into a `CameraError` that says what to check."""
    try:
        yield
    except ExitError as error:
        raise CameraError(f"{name}: nothing received for too long; {what_to_check}") from error
    except (FFmpegError, OSError, MessageError, ValueError) as error:
        raise CameraError(f"{name}: {error}; {what_to_check}") from error


def open_stream(source: StreamSource | RtpSource) -> InputContainer:
    """Return the opened stream; blocks for at most its connect time.

    Raises:
        FFmpegError, OSError: nothing there, nothing in time, or nothing that can be read.
    """
    timeout = (source.connect_timeout_s, source.stall_s)
    options = {**LOW_LATENCY, "protocol_whitelist": PROTOCOLS}
    if isinstance(source, RtpSource):
        sdp = io.BytesIO(make_sdp(source).encode())
        return av.open(sdp, "r", format="sdp", options=options, timeout=timeout)
    if source.url.endswith(".sdp"):
        sdp = io.BytesIO(Path(source.url).read_bytes())
        return av.open(sdp, "r", format="sdp", options=options, timeout=timeout)
    if source.url.startswith("rtsp"):
        options["rtsp_transport"] = source.transport
    return av.open(source.url, "r", format=source.format, options=options, timeout=timeout)


def read(
    container: InputContainer, counts: Counts, clock: Clock, *, decode: bool
) -> Iterator[Arrival]:
    """Yield what every packet of the first video stream brings, stamped with its arrival.

    Raises:
        FFmpegError: the stream has stalled or broken.
        ValueError: it has no video.
    """
    if not container.streams.video:
        raise ValueError("no video in the stream")
    stream = container.streams.video[0]
    decoder = Decoder(stream, counts, low_delay=True, decode=decode)
    for packet in container.demux(stream):
        pictures = [picture_of(*found) for found in decoder.feed(packet, clock.now_ns())]
        yield Arrival(pictures, decoder.take_units())
