"""H.264 over RTP and UDP, forwarded as it came: nothing but the standard library."""

import socket
import struct
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager, suppress

from juncnet.clocks import NS_PER_S, Clock
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.h264_rtp import Depacketiser
from juncnet_services.frame_capture.live import Arrival
from juncnet_services.frame_capture.rtp import (
    RtpError,
    RtpOrder,
    RtpPacket,
    parse_rtp,
    picture_loss_indication,
)
from juncnet_services.frame_capture.sources import RtpSource

MAX_DATAGRAM = 65536
RECEIVE_BUFFER = 4 << 20
"""Bytes that the kernel keeps while this process waits for its turn; it may grant less."""
LEAST_WAIT_S = 0.001
"""What waits in the buffer is read even when the time is over: this process may have slept."""


class RtpReceiver:
    """Receives from one camera, `source.sender` or whoever sends first; asks it for key frames.

    Packets of other hosts are dropped. Silence of the camera ends the connection, however much the
    others send; the next connection is anyone's again, unless `source.sender` names the camera.
    """

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

    def find(self) -> str:
        """Return the camera's address: `source.sender`, or whose first packet comes now.

        Raises:
            CameraError: the port cannot be had, or nothing came.
        """
        if self._source.sender is not None:
            return str(self._source.sender)
        with self._explained(), closing(_open_port(self._source)) as port:
            (host, _), _, _ = next(self._packets(port, Counts()))
        return host

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
        for sender, packet, now_ns in self._packets(port, counts):
            self._camera = sender, packet.source
            for lost, released in order.push(packet):
                units = pictures.push(released, lost, now_ns)
                if units:
                    yield Arrival([], units)

    def _packets(
        self, port: socket.socket, counts: Counts
    ) -> Iterator[tuple[tuple[str, int], RtpPacket, int]]:
        """Yield the camera's packets: sender, packet, arrival [ns].

        Raises:
            TimeoutError: the camera is silent.
        """
        host = None if self._source.sender is None else str(self._source.sender)
        until_ns = self._clock.now_ns() + int(self._source.connect_timeout_s * NS_PER_S)
        told = False
        while True:
            left_s = (until_ns - self._clock.now_ns()) / NS_PER_S
            port.settimeout(max(LEAST_WAIT_S, left_s))
            datagram, sender = port.recvfrom(MAX_DATAGRAM)
            now_ns, packet = self._clock.now_ns(), None
            if host in (None, sender[0]):
                packet = self._parsed(datagram, counts)
            elif not told:
                told = True
                counts.problems.append(self._stranger(sender[0], host))
            if packet is not None:
                host = sender[0]
                until_ns = now_ns + int(self._source.stall_s * NS_PER_S)
                yield sender, packet, now_ns
            elif now_ns >= until_ns:
                raise TimeoutError

    def _parsed(self, datagram: bytes, counts: Counts) -> RtpPacket | None:
        """Return a packet of the video; None: RTCP on the same port, sound, or no RTP at all."""
        try:
            packet = parse_rtp(datagram)
        except RtpError:
            counts.corrupt += 1
            return None
        return packet if packet.payload_type == self._source.payload else None

    def _stranger(self, stranger: str, host: str | None) -> str:
        return (
            f"RTP port {self._source.port}: {stranger} sends too and is not heard, {host} is the "
            "camera: stop the other sender; source.sender names the camera beforehand"
        )

    @contextmanager
    def _explained(self) -> Generator[None]:
        where, named = f"RTP port {self._source.port}", self._source.sender
        try:
            yield
        except TimeoutError as error:
            raise CameraError(
                f"{where}: nothing received for too long; is {named or 'the camera'} sending H.264 "
                f"as RTP payload {self._source.payload} to UDP port {self._source.port} of this "
                "host, does a firewall drop it?"
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
