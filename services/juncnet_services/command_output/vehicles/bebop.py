"""Parrot Bebop 2 over its WiFi: found by address or mDNS, asked by TCP, flown by UDP.

The drone keeps its last PCMD while nothing new comes, and notices a vanished controller only after
some 10 s; then it hovers. Hold is a PCMD whose tilt does not count: it keeps its place.
"""

import socket
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, field_validator

from juncnet.extras import install_command
from juncnet_services.command_output.vehicles import (
    DriverOptions,
    Hold,
    arsdk,
    bebop_discovery,
    usual_capabilities,
)
from juncnet_services.command_output.vehicles.bebop_flight import (
    STEP_NS,
    BebopCore,
    Tuning,
    hold_packets,
)
from juncnet_services.command_output.vehicles.pacing import PacedVehicle

CONNECT_S = 3.0
DISCOVER = "discover"
MAX_ANSWER = 65_536
END_S = {"hold": 0.2, "land": 0.6}
"""Time at the end for the last commands, repeats included."""


class BebopOptions(DriverOptions):
    """Options of the vehicle `bebop`."""

    address: str = "192.168.42.1"
    """Of the drone in its own network; `discover` looks for it by mDNS (extra [bebop])."""
    discovery_port: int = Field(default=arsdk.DISCOVERY_PORT, ge=1, le=65535)
    events_port: int = Field(default=43210, ge=0, le=65535)
    """Where this host listens for the drone; 0: any free port."""
    video: Literal["480p", "720p", "off"] = "480p"
    """856x480 (1080p is recorded on board then), 1280x720, or none."""
    video_port: int = Field(default=arsdk.VIDEO_PORT, ge=1, le=65534)
    """Where the video goes: `frame_capture.source = { kind = "rtp", port = 55004 }`."""
    camera_tilt_deg: int = Field(default=-20, ge=-83, le=17)
    """Of the picture against the horizon; the same as `camera.pitch_rad`, with the other sign."""
    at_end: Literal["hold", "land"] = "hold"
    """What the drone does when command_output ends in order."""
    tuning: Tuning = Tuning()

    @field_validator("address")
    @classmethod
    def _can_be_looked_for(cls, address: str) -> str:
        if address == DISCOVER and not bebop_discovery.is_installed():
            raise ValueError(
                f"discover needs zeroconf: name the address, or {install_command('bebop')}"
            )
        return address


class BebopVehicle(PacedVehicle):
    """A Bebop 2; connects, and connects anew, by itself."""

    Options: ClassVar[type[DriverOptions]] = BebopOptions

    def __init__(self, options: BebopOptions, flight_dir: Path) -> None:
        del flight_dir
        super().__init__(BebopCore(options.tuning, _setup(options), options.camera_tilt_deg))
        self.capabilities = usual_capabilities("copter", telemetry=True)
        self._options = options
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out.setblocking(False)
        self._hold: Hold | None = None
        self.start()

    @contextmanager
    def connect(self) -> Generator["BebopLink"]:
        events = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with closing(events):
            events.bind(("", self._options.events_port))
            events.setblocking(False)
            drone = self._find()
            port = self._introduce(drone, events.getsockname()[1])
            self._out.connect((drone[0], port))
            self._hold = self._hold or Hold(self._out.fileno(), None, hold_packets(), STEP_NS)
            yield BebopLink(events, self._out, drone[0])

    def hold(self) -> Hold | None:
        return self._hold

    def close(self) -> None:
        at_end = self._options.at_end
        self.finish(at_end == "land", END_S[at_end])
        self._out.close()

    def _find(self) -> tuple[str, int]:
        """Return where the drone listens for controllers; raises `ConnectionError`."""
        options = self._options
        if options.address == DISCOVER:
            return bebop_discovery.find(CONNECT_S)
        return options.address, options.discovery_port

    def _introduce(self, drone: tuple[str, int], events_port: int) -> int:
        """Return the port for commands, as the drone names it.

        Raises:
            ConnectionError: nobody answers there.
            ArsdkError: the drone refuses.
        """
        request = arsdk.discovery_request(events_port, self._options.video_port)
        try:
            with socket.create_connection(drone, CONNECT_S) as link:
                link.sendall(request)
                answer = _answer(link)
        except OSError as error:
            raise ConnectionError(
                f"no Bebop at {drone[0]}:{drone[1]} ({error}): is it on, and is this host in "
                "its WiFi?"
            ) from error
        return arsdk.control_port(answer)


class BebopLink:
    """Events in on one socket, commands out on another, which the guard has too."""

    def __init__(self, events: socket.socket, out: socket.socket, address: str) -> None:
        self._events, self._out = events, out
        self._drone = socket.gethostbyname(address)

    def fileno(self) -> int:
        return self._events.fileno()

    def send(self, data: bytes) -> None:
        self._out.send(data)

    def receive(self) -> bytes | None:
        datagram, sender = self._events.recvfrom(65_535)
        return datagram if sender[0] == self._drone else None


def _answer(link: socket.socket) -> bytes:
    """Return what came until there is a whole JSON object, the end, or too much."""
    answer = b""
    while len(answer) < MAX_ANSWER and not answer.rstrip(b"\0 \n").endswith(b"}"):
        data = link.recv(4096)
        if not data:
            break
        answer += data
    return answer


def _setup(options: BebopOptions) -> tuple[bytes, ...]:
    """Return what the drone is told when it is connected: its settings, and to tell its own."""
    tuning = options.tuning
    video = (
        arsdk.video_resolutions(options.video == "720p"),
        arsdk.LOW_LATENCY,
        arsdk.VIDEO_ON,
    )
    return (
        arsdk.ALL_SETTINGS,
        arsdk.ALL_STATES,
        arsdk.maximum(arsdk.MAX_TILT, tuning.max_tilt_deg),
        arsdk.maximum(arsdk.MAX_VERTICAL, tuning.max_vertical_mps),
        arsdk.maximum(arsdk.MAX_ROTATION, tuning.max_rotation_degps),
        *(video if options.video != "off" else ()),
    )
