"""H.264 over RTP and UDP, forwarded as it came: nothing but the standard library."""

import socket
import struct
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager, suppress

from juncnet.clocks import Clock
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.h264_rtp import Depacketiser
from juncnet_services.frame_capture.live import Arrival
from juncnet_services.frame_capture.rtp import (
    RtpError,
    RtpOrder,
    parse_rtp,
    picture_loss_indication,
)
from juncnet_services.frame_capture.sources import RtpSource

MAX_DATAGRAM = 65536
RECEIVE_BUFFER = 4 << 20
"""Bytes that the kernel keeps while this process waits for its turn; it may grant less."""


class RtpReceiver:
    """Receives from the first camera that sends; asks that one for key frames."""

    def __init__(self, source: RtpSource, clock: Clock) -> None:
        self._source, self._clock = source, clock
        self._socket: socket.socket | None = None
        self._camera: tuple[tuple[str, int], int] | None = None

    @contextmanager
    def connect(self, counts: Counts) -> Generator[Iterator[Arrival]]:
        """Open the port, and give what arrives until the camera is silent for too long.

        Raises:
            CameraError: the port cannot be had, or nothing came.
        """
        with self._explained(), closing(_open_port(self._source)) as port:
            self._socket, self._camera = port, None
            try:
                yield self._arrivals(port, counts)
            finally:
                self._socket = None

    def ask_key_frame(self) -> None:
        """Ask the camera for a key frame: on the port that it sends from, and on its RTCP port."""
        port, camera = self._socket, self._camera
        if port is None or camera is None:
            return
        (host, number), source = camera
        with suppress(OSError):
            for rtcp in (number, number + 1):
                port.sendto(picture_loss_indication(source), (host, rtcp))

    def _arrivals(self, port: socket.socket, counts: Counts) -> Iterator[Arrival]:
        order, pictures = RtpOrder(), Depacketiser(counts)
        port.settimeout(self._source.connect_timeout_s)
        while True:
            datagram, sender = port.recvfrom(MAX_DATAGRAM)
            now_ns = self._clock.now_ns()
            try:
                packet = parse_rtp(datagram)
            except RtpError:
                counts.corrupt += 1
                continue
            if packet.payload_type != self._source.payload:
                continue  # RTCP on the same port, or sound
            if self._camera is None:
                port.settimeout(self._source.stall_s)
            self._camera = sender, packet.source
            for lost, released in order.push(packet):
                units = pictures.push(released, lost, now_ns)
                if units:
                    yield Arrival([], units)

    @contextmanager
    def _explained(self) -> Generator[None]:
        where = f"RTP port {self._source.port}"
        try:
            yield
        except TimeoutError as error:
            raise CameraError(
                f"{where}: nothing received for too long; is the camera sending H.264 as RTP "
                f"payload {self._source.payload} to UDP port {self._source.port} of this host, "
                "does a firewall drop it?"
            ) from error
        except OSError as error:
            raise CameraError(f"{where}: {error}; has another process the port?") from error


def _open_port(source: RtpSource) -> socket.socket:
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        group = socket.inet_aton(socket.gethostbyname(source.address))
        if 224 <= group[0] <= 239:
            port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            port.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4sl", group, 0)
            )
        port.bind((source.address, source.port))
    except OSError:
        port.close()
        raise
    return port
