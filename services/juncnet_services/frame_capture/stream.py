"""Live H.264 over a network: RTSP, RTP, MPEG-TS or raw H.264 over UDP or TCP, through PyAV."""

import io
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import av
from av.container import InputContainer
from av.error import ExitError, FFmpegError

from juncnet.clocks import Clock
from juncnet.messages import MessageError
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.decoding import Decoder
from juncnet_services.frame_capture.live import Arrival, Connect
from juncnet_services.frame_capture.planes import picture_of
from juncnet_services.frame_capture.rtp_camera import RtpReceiver
from juncnet_services.frame_capture.sources import RtpSource, StreamSource

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


def make_sdp(source: RtpSource, sender: str) -> str:
    """Return the session description (RFC 8866) of an RTP source.

    Packets of other hosts than `sender` are dropped: source-filter, RFC 4570.
    """
    return (
        "v=0\r\n"
        f"o=- 0 0 IN IP4 {source.address}\r\n"
        "s=camera\r\n"
        f"c=IN IP4 {source.address}\r\n"
        "t=0 0\r\n"
        f"a=source-filter: incl IN IP4 * {sender}\r\n"
        f"m=video {source.port} RTP/AVP {source.payload}\r\n"
        f"a=rtpmap:{source.payload} {source.codec.upper()}/90000\r\n"
        f"a=fmtp:{source.payload} packetization-mode=1\r\n"
    )


def stream_connector(source: StreamSource | RtpSource, clock: Clock, *, decode: bool) -> Connect:
    """Return what opens `source` for a `LiveCamera`."""

    @contextmanager
    def connect(counts: Counts) -> Generator[Iterator[Arrival]]:
        with explained(source_name(source), advice(source)), _open(source, clock) as container:
            yield read(container, counts, clock, decode=decode)

    return connect


def source_name(source: StreamSource | RtpSource) -> str:
    """Return how messages name the source."""
    return source.url if isinstance(source, StreamSource) else f"RTP port {source.port}"


def advice(source: StreamSource | RtpSource) -> str:
    """Return what to check when the source gives nothing."""
    if isinstance(source, RtpSource):
        return (
            f"is {source.sender or 'the camera'} sending H.264 as RTP payload {source.payload} to "
            f"UDP port {source.port} of this host, does a firewall drop it, has another process "
            "the port?"
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


def _open(source: StreamSource | RtpSource, clock: Clock) -> InputContainer:
    """Return the opened stream; blocks for at most its connect time, of RTP for twice that.

    Raises:
        CameraError, FFmpegError, OSError: nothing there, nothing in time, or nothing that can be
            read.
    """
    timeout = (source.connect_timeout_s, source.stall_s)
    options = {**LOW_LATENCY, "protocol_whitelist": PROTOCOLS}
    if isinstance(source, RtpSource):
        sdp = io.BytesIO(make_sdp(source, RtpReceiver(source, clock).find()).encode())
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
