"""A Bebop 2 for tests: how it moves, and a drone in Python that speaks ARSDK3 over loopback."""

import json
import math
import socket
import struct
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from juncnet_services.command_output.vehicles import arsdk
from juncnet_services.command_output.vehicles.arsdk import (
    Buffer,
    FlyingState,
    Frame,
    FrameType,
    command,
)

GRAVITY = 9.81
DRAG_1PS = 0.4
TILT_LAG_S = 0.2
EVENTS_S = 0.2


@dataclass
class Body:
    """A point that tilts, slides and turns as a Bebop does; north, east, yaw clockwise."""

    max_tilt_deg: float = 15.0
    max_rotation_degps: float = 100.0
    max_vertical_mps: float = 1.5
    state: FlyingState = FlyingState.LANDED
    pcmd: tuple[int, int, int, int, int] = (0, 0, 0, 0, 0)
    """Flag, roll, pitch, yaw, gaz: kept until the next, whoever has died."""
    yaw_rad: float = 0.6
    north_mps: float = 0.0
    east_mps: float = 0.0
    up_mps: float = 0.0
    height_m: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    changed_s: float = 0.0

    def told(self, payload: bytes, now_s: float) -> None:
        """Obey a command."""
        if payload == arsdk.TAKE_OFF and self.state is FlyingState.LANDED:
            self.state, self.changed_s = FlyingState.TAKING_OFF, now_s
        elif payload == arsdk.LANDING and self.state in arsdk.AIRBORNE:
            self.state, self.changed_s = FlyingState.LANDING, now_s
        elif payload == arsdk.EMERGENCY:
            self.state = FlyingState.EMERGENCY
        elif payload[:4] == arsdk.pcmd()[:4]:
            self.pcmd = struct.unpack_from("<Bbbbb", payload, 4)

    def step(self, seconds: float, now_s: float) -> None:
        """Move on by `seconds`."""
        after = {
            FlyingState.TAKING_OFF: FlyingState.HOVERING,
            FlyingState.LANDING: FlyingState.LANDED,
        }
        if self.state in after and now_s - self.changed_s > 1.0:
            self.state = after[self.state]
        if self.state not in arsdk.AIRBORNE:
            self.north_mps = self.east_mps = self.up_mps = 0.0
            return
        flag, roll, pitch, yaw, gaz = self.pcmd
        self.yaw_rad += math.radians(self.max_rotation_degps * yaw / 100) * seconds
        self.up_mps = self.max_vertical_mps * gaz / 100
        self.height_m += self.up_mps * seconds
        forward, right = self.body_speed()
        if flag:
            wanted = (self.max_tilt_deg * pitch / 100, self.max_tilt_deg * roll / 100)
        else:  # its own brake: tilts against its speed
            wanted = (max(-20.0, min(20.0, -8 * forward)), max(-20.0, min(20.0, -8 * right)))
        part = min(1.0, seconds / TILT_LAG_S)
        ahead = self.tilt[0] + part * (wanted[0] - self.tilt[0])
        aside = self.tilt[1] + part * (wanted[1] - self.tilt[1])
        self.tilt = (ahead, aside)
        forward += (GRAVITY * math.tan(math.radians(ahead)) - DRAG_1PS * forward) * seconds
        right += (GRAVITY * math.tan(math.radians(aside)) - DRAG_1PS * right) * seconds
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        self.north_mps = forward * cosine - right * sine
        self.east_mps = forward * sine + right * cosine

    def body_speed(self) -> tuple[float, float]:
        """Return the speeds forward and to the right."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (
            self.north_mps * cosine + self.east_mps * sine,
            self.east_mps * cosine - self.north_mps * sine,
        )

    def events(self) -> list[bytes]:
        """Return what the drone tells 5 times a second."""
        yaw = math.remainder(self.yaw_rad, math.tau)
        return [
            command(1, 4, 5, "fff", self.north_mps, self.east_mps, -self.up_mps),
            command(1, 4, 6, "fff", 0.0, 0.0, yaw),
            command(1, 4, 4, "ddd", 500.0, 500.0, 500.0),
        ]


@dataclass
class Drone:
    """A drone on loopback; `commands` holds (time in s, buffer, sequence, payload) as obeyed."""

    status: int = 0
    acknowledges: bool = True
    body: Body = field(default_factory=Body)
    commands: list[tuple[float, int, int, bytes]] = field(
        default_factory=list[tuple[float, int, int, bytes]]
    )
    acks: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])
    pongs: int = 0
    request: dict[str, object] = field(default_factory=dict[str, object])
    silent: bool = False

    def __post_init__(self) -> None:
        self.discovery = socket.create_server(("127.0.0.1", 0))
        self.link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.link.bind(("127.0.0.1", 0))
        self.link.settimeout(0.01)
        self.ended = threading.Event()
        self.controller: tuple[str, int] | None = None
        self.last: dict[int, int] = {}
        self.sequences: dict[int, int] = {}
        self.connections = 0

    @property
    def port(self) -> int:
        return self.discovery.getsockname()[1]

    def payloads(self, buffer: int | None = None) -> list[bytes]:
        """Return the commands obeyed, of one buffer or of all."""
        return [p for _, b, _, p in list(self.commands) if buffer in (None, b)]

    def tell(self, payload: bytes, buffer: int = Buffer.EVENTS, kind: int = FrameType.DATA) -> None:
        """Send an event to the controller."""
        if self.controller is None or self.silent:
            return
        number = self.sequences[buffer] = (self.sequences.get(buffer, -1) + 1) & 0xFF
        self.link.sendto(
            arsdk.encode(Frame(FrameType(kind), buffer, number, payload)), self.controller
        )

    def answer(self) -> None:
        """Serve discovery."""
        self.discovery.settimeout(0.1)
        while not self.ended.is_set():
            try:
                asked, _ = self.discovery.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            with asked:
                asked.settimeout(2)
                self.request = json.loads(asked.recv(4096))
                port = self.link.getsockname()[1]
                answer = {"status": self.status, "c2d_port": port}
                asked.sendall(json.dumps(answer).encode() + b"\0")
            if self.status == 0:
                self.last.clear()
                self.connections += 1
                self.controller = ("127.0.0.1", int(str(self.request["d2c_port"])))
                self.report()

    def report(self) -> None:
        """Tell state, battery and maxima, acknowledged by the controller."""
        body = self.body
        for payload in (
            command(1, 4, 1, "I", body.state),
            command(0, 5, 1, "B", 87),
            command(1, 6, 1, "fff", body.max_tilt_deg, 5, 35),
            command(1, 12, 0, "fff", body.max_vertical_mps, 0.5, 6),
            command(1, 12, 1, "fff", body.max_rotation_degps, 10, 200),
        ):
            self.tell(payload, Buffer.EVENTS_WITH_ACK, FrameType.DATA_WITH_ACK)

    def fly(self) -> None:
        """Obey, move and tell until the end."""
        told_s = at_s = time.monotonic()
        while not self.ended.is_set():
            try:
                self.hear(self.link.recv(65_535))
            except TimeoutError:
                pass
            except OSError:
                return
            now_s = time.monotonic()
            before = self.body.state
            self.body.step(now_s - at_s, now_s)
            at_s = now_s
            if self.body.state is not before:
                self.tell(command(1, 4, 1, "I", self.body.state), Buffer.EVENTS_WITH_ACK, 4)
            if now_s - told_s >= EVENTS_S:
                told_s = now_s
                self.tell(struct.pack("<qq", 1, 2), Buffer.PING)
                for payload in self.body.events():
                    self.tell(payload)

    def hear(self, datagram: bytes) -> None:
        """Take a datagram, by the rules of libarsdk for acknowledgements and numbers."""
        frames, rest = arsdk.decode(datagram)
        assert rest == b""
        for frame in frames:
            if frame.kind is FrameType.ACK:
                self.acks.append((frame.buffer, frame.payload[0]))
                continue
            if frame.buffer == Buffer.PONG:
                assert frame.payload == struct.pack("<qq", 1, 2)
                self.pongs += 1
                continue
            if frame.kind is FrameType.DATA_WITH_ACK and self.acknowledges:
                self.tell(bytes([frame.sequence]), frame.buffer + arsdk.ACK_OFFSET, FrameType.ACK)
            newer = frame.sequence - self.last.get(frame.buffer, 255)
            if not (newer > 0 or newer < -10):
                continue
            self.last[frame.buffer] = frame.sequence
            now_s = time.monotonic()
            self.commands.append((now_s, frame.buffer, frame.sequence, frame.payload))
            before = self.body.state
            self.body.told(frame.payload, now_s)
            if self.body.state is not before:
                self.tell(command(1, 4, 1, "I", self.body.state), Buffer.EVENTS_WITH_ACK, 4)


@contextmanager
def flying_drone(drone: Drone | None = None) -> Generator[Drone]:
    """Run a drone while the context lasts."""
    drone = drone or Drone()
    threads = [threading.Thread(target=t, daemon=True) for t in (drone.answer, drone.fly)]
    for thread in threads:
        thread.start()
    try:
        yield drone
    finally:
        drone.ended.set()
        for thread in threads:
            thread.join(2)
        drone.discovery.close()
        drone.link.close()
