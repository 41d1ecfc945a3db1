"""Every decoder of bytes from outside, as something that eats any input: for tests and fuzzing.

A target gives back whether the input was understood. It lets through only the error that the
decoder documents; everything else that happens is a fault. What is understood is held against what
must be true of it. Inputs of several datagrams are theirs in a row, each behind its length.
"""

import contextlib
import json
import random
import socket
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from juncnet.frames import FrameLayout
from juncnet.frames_wire import PREFIX_BYTES, PrefixPacker, unpack
from juncnet.messages import MessageError, PixelFormat, Stamp
from juncnet.simulation import link
from juncnet_services.command_output.vehicles import arsdk, ros2_link
from juncnet_services.command_output.vehicles.arsdk import Buffer, Frame, FrameType, command
from juncnet_services.command_output.vehicles.bebop_flight import BebopCore, Tuning
from juncnet_services.frame_capture.contract import Counts
from juncnet_services.frame_capture.h264 import START_CODE, H264Track, nal_type, split_annex_b
from juncnet_services.frame_capture.h264_rtp import Depacketiser, packetise
from juncnet_services.frame_capture.rtp import RtpError, RtpOrder, parse_rtp
from juncnet_services.frame_capture.rtsp import Conversation, RtspError, find_video

STRANGE = (
    b"null",
    b"NaN",
    b"-Infinity",
    b"1e999",
    b"\xff",
    b'"',
    b"{",
    b"]",
    b"\\u0000",
    b"9" * 40,
    b"\0\0\0\1",
    b"\xc2\xb2",
)


@dataclass(frozen=True)
class Target:
    """A decoder: inputs that it understands, and how it is run."""

    seeds: tuple[bytes, ...]
    run: Callable[[bytes], bool]
    seal: Callable[[bytes], bytes] | None = None
    """Makes the checksum of a damaged input right, so that what is behind it is reached."""

    def damaged(self, chance: random.Random) -> bytes:
        """Return a seed with one to three things wrong; its checksum is right half of the time."""
        data = chance.choice(self.seeds)
        for _ in range(chance.randrange(1, 4)):
            data = mutated(data, chance)
        return self.seal(data) if self.seal is not None and chance.random() < 0.5 else data


def mutated(text: bytes, chance: random.Random) -> bytes:
    """Return `text` with a byte changed, a piece removed, repeated or replaced."""
    at = chance.randrange(len(text) + 1)
    upto = min(len(text), at + chance.randrange(12))
    match chance.randrange(5):
        case 0:
            middle = bytes([chance.randrange(256)])
            upto = at + 1
        case 1:
            middle = b""
        case 2:
            middle = 2 * text[at:upto]
        case 3:
            middle = chance.choice(STRANGE)
        case _:
            middle = str(chance.choice((-1, 0, 2**63, -(2**63), 1e308, 2**70))).encode()
    return text[:at] + middle + text[upto:]


def in_a_row(datagrams: Iterable[bytes]) -> bytes:
    """Return datagrams as one input."""
    return b"".join(struct.pack("<H", len(d)) + d for d in datagrams)


def apart(data: bytes) -> Iterator[bytes]:
    """Yield the datagrams of an input, the last one as far as it goes."""
    at = 0
    while at + 2 <= len(data):
        (size,) = struct.unpack_from("<H", data, at)
        yield data[at + 2 : at + 2 + size]
        at += 2 + size


# Bebop

EVENTS = (
    command(1, 4, 1, "I", 2),
    command(0, 5, 1, "B", 87),
    command(1, 4, 4, "ddd", 48.1, 11.5, 500.0),
    command(1, 4, 5, "fff", 1.0, -0.5, 0.1),
    command(1, 4, 6, "fff", 0.0, 0.1, 1.5),
    command(1, 4, 8, "d", 1.0),
    command(1, 6, 1, "fff", 15.0, 5.0, 35.0),
    command(1, 12, 0, "fff", 1.5, 0.5, 6.0),
)
FRAMES = tuple(
    arsdk.encode(Frame(FrameType.DATA_WITH_ACK, Buffer.EVENTS_WITH_ACK, n, payload))
    for n, payload in enumerate(EVENTS)
)


def arsdk_frames(data: bytes) -> bool:
    """Frames of a datagram, and the event in each."""
    frames, rest = arsdk.decode(data)
    assert b"".join(map(arsdk.encode, frames)) + rest == data
    understood = not rest
    for frame in frames:
        try:
            arsdk.event(frame.payload)
        except arsdk.ArsdkError:
            understood = False
    return understood


def arsdk_discovery(data: bytes) -> bool:
    """The answer to a Bebop's discovery."""
    try:
        assert 0 < arsdk.control_port(data) < 65536
    except arsdk.ArsdkError:
        return False
    return True


def bebop(data: bytes) -> bool:
    """A conversation with a Bebop, as its driver takes it: it always knows what to send."""
    core, now_ns = BebopCore(Tuning(), (arsdk.ALL_STATES,), -20), 1_000_000_000
    core.connected(now_ns)
    understood = True
    for datagram in apart(data):
        core.heard(datagram, now_ns)
        now_ns += 10_000_000
        understood &= arsdk_frames(datagram)
    core.telemetry(now_ns, 1.0)
    assert isinstance(core.trouble, str)
    return understood


# Video


def small_video() -> list[bytes]:
    """Return a few access units of H.264, Annex B."""
    import av

    context: Any = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = 64, 48, "yuv420p"
    context.framerate, context.time_base, context.gop_size = Fraction(25), Fraction(1, 25), 3
    context.options = {"preset": "ultrafast", "tune": "zerolatency"}
    pixels = np.random.default_rng(1).integers(0, 255, (4, 72, 64), np.uint8)
    units: list[bytes] = []
    for number, picture in enumerate(pixels):
        frame: Any = av.VideoFrame.from_ndarray(picture, format="yuv420p")
        frame.pts = number
        units += [bytes(packet) for packet in context.encode(frame)]
    return units


UNITS = small_video()
SETS = [nal for nal in split_annex_b(UNITS[0]) if nal_type(nal) in (7, 8)]
STREAM = tuple(
    datagram
    for number, unit in enumerate(UNITS)
    for datagram in packetise(split_annex_b(unit), 10 * number, 3600 * number, 7)
)


def rtp(data: bytes) -> bool:
    """RTP datagrams, put in order and together."""
    order, pictures, understood = RtpOrder(), Depacketiser(Counts()), True
    for datagram in apart(data):
        try:
            packet = parse_rtp(datagram)
        except RtpError:
            understood = False
            continue
        for lost, released in order.push(packet):
            for unit in pictures.push(released, lost, 0):
                assert unit.payload.startswith(START_CODE)
                assert unit.lost_before >= 0
    return understood


def h264(data: bytes) -> bool:
    """A container's header and the packets that follow, their losses counted."""
    header, *packets = [*apart(data)] or [b""]
    track, understood = H264Track(header), True
    for packet in packets:
        units = track.split(packet)
        lost = track.lost_before(units)
        assert lost is None or lost >= 0
        track.annex_b(units, key_frame=True)
        understood &= bool(units)
    return understood


def avcc_header() -> bytes:
    """Return the header of an MP4 file for this video."""
    sps, pps = (struct.pack(">H", len(nal)) + nal for nal in SETS)
    return b"\x01" + SETS[0][1:4] + b"\xff\xe1" + sps + b"\x01" + pps


DESCRIPTION = (
    b"v=0\r\nm=audio 0 RTP/AVP 0\r\nm=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
    b"a=fmtp:96 packetization-mode=1;sprop-parameter-sets=Z0LAHtkDxWhAAAADAEAAAAwDxYuS,aMuMsg==\r\n"
    b"a=control:trackID=1\r\n"
)
ANSWER = b"RTSP/1.0 200 OK\r\nCSeq: 1\r\nContent-Length: %d\r\n\r\n%s" % (
    len(DESCRIPTION),
    DESCRIPTION,
)


def rtsp(data: bytes) -> bool:
    """What a camera answers over RTSP, and the description in it."""
    ours, camera = socket.socketpair()
    with ours, camera:
        camera.sendall(data[:60_000])
        camera.shutdown(socket.SHUT_WR)
        try:
            answer = Conversation(ours, "rtsp://camera/live").ask("DESCRIBE", "rtsp://camera/live")
            find_video(answer.body.decode(errors="replace"), "rtsp://camera/live")
        except (RtspError, ConnectionError):
            return False
    return True


# This project's own


def frame_prefix(data: bytes) -> bool:
    """What stands before the pixels of a frame between processes."""
    try:
        header, layout, writer, _serial = unpack(data)
    except MessageError:
        return False
    assert unpack(PrefixPacker(writer).pack(header, layout)) == (header, layout, writer, 0)
    return True


def sealed_prefix(data: bytes) -> bytes:
    """Return `data` as a prefix whose checksum is right."""
    body = data[: PREFIX_BYTES - 4].ljust(PREFIX_BYTES - 4, b"\0")
    return body + struct.pack("<I", zlib.crc32(body))


PREFIX = PrefixPacker(5).pack(
    Stamp(epoch=1, sequence=2, time_ns=3, clock="boot-1"),
    FrameLayout.packed(PixelFormat.I420, 64, 48),
)


def simulator_link(data: bytes) -> bool:
    """The simulated vehicle's link, in both directions."""
    understood = 0
    for decode in (link.decode_command, link.decode_telemetry):
        try:
            decode(data)
            understood += 1
        except link.LinkError:
            continue
    return understood > 0


TELEMETRY = link.encode(link.Telemetry(1, 1.0, 2.0, 3.0, 0.1, 1.0, 0.0, 0.0, True, 0.9))


def ros2(data: bytes) -> bool:
    """What command_output says to its link process for ROS 2."""
    return ros2_link.wish_in(data) is not None


# MAVLink


def mavlink_target() -> Target:
    """Return the autopilot's bytes, as the driver takes them.

    Raises:
        ImportError: pymavlink is not installed.
    """
    from autopilot import STRICT, Autopilot
    from juncnet_services.command_output.vehicles.mavlink_flight import Flight, MavlinkCore
    from juncnet_services.command_output.vehicles.mavlink_wire import Wire

    pilot = Autopilot("copter", STRICT, px4=True)
    packets = [
        *pilot.told(1.0),
        *pilot.parameter("COM_OBL_RC_ACT"),
        *pilot.parameter("NAV_RCL_ACT"),
    ]

    def run(data: bytes) -> bool:
        core, now_ns = MavlinkCore(Flight()), 1_000_000_000
        core.connected(now_ns)
        core.heard(packets[0], now_ns)
        core.heard(data, now_ns)
        core.telemetry(now_ns, 1.0)
        assert isinstance(core.trouble, str)
        return bool(Wire(1).read(data))

    return Target(tuple(packets), run, sealed_mavlink)


def sealed_mavlink(data: bytes) -> bytes:
    """Return `data` as one MAVLink 2 packet whose length and checksum are right."""
    from pymavlink.dialects.v20 import common as dialect

    payload = data[10:-2][:255]
    head = b"\xfd" + bytes([len(payload), 0, 0]) + data[4:10].ljust(6, b"\1")
    known = dialect.mavlink_map.get(int.from_bytes(head[7:10], "little"))
    crc = dialect.x25crc(head[1:] + payload + bytes([known.crc_extra if known else 0]))
    return head + payload + struct.pack("<H", crc.crc)


TARGETS = {
    "arsdk_frames": Target((*FRAMES, b"".join(FRAMES)), arsdk_frames),
    "arsdk_discovery": Target(
        (json.dumps({"status": 0, "c2d_port": 54321}).encode() + b"\0",), arsdk_discovery
    ),
    "bebop": Target((in_a_row(FRAMES), in_a_row(FRAMES[::-1])), bebop),
    "rtp": Target((in_a_row(STREAM), in_a_row(STREAM[:4])), rtp),
    "h264": Target((in_a_row([avcc_header(), *UNITS]), in_a_row([b"", *UNITS])), h264),
    "rtsp": Target((ANSWER,), rtsp),
    "frame_prefix": Target((PREFIX,), frame_prefix, sealed_prefix),
    "simulator_link": Target((TELEMETRY, link.encode(link.HOLD)), simulator_link),
    "ros2": Target((ros2_link.HOLD, ros2_link.DATAGRAM.pack(9, 1.0, 0.0, 0.0, 0.5)), ros2),
}
with contextlib.suppress(ImportError):
    TARGETS["mavlink"] = mavlink_target()
