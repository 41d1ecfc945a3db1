"""Robots that exist for the dashboard only: their messages, and a bus on which they answer."""

import http.client
import json
import math
import threading
from collections.abc import Generator
from contextlib import closing, contextmanager
from typing import Any

import cv2
import numpy as np

from fakes import FakeBus
from juncnet import messages as m
from juncnet import topics as t
from juncnet.camera import CameraGeometry
from juncnet.flight import HostClock
from juncnet_services.dashboard.access import HOST, Address, new_address
from juncnet_services.dashboard.board import Board
from juncnet_services.dashboard.pages import About, served
from scenes import MODEL

MISSION = m.Mission(
    name="third_left", turns=(m.Turn(at=3, turn="left"), m.Turn(at=2, angle_deg=60)), finish_after=4
)
THRESHOLDS = m.Thresholds(enter=0.5, certain=0.93, leave=0.35)
FOLLOWER = "package.module:Follower"


class AnsweringBus(FakeBus):
    """A bus whose robots obey: orders are acknowledged, requests answered, all on a real clock."""

    def __init__(self) -> None:
        super().__init__(service="dashboard")
        self.clock: Any = HostClock()
        self.orders: list[tuple[str, m.Override, int]] = []
        """Robot, order, and when it was published."""
        self.requests: list[tuple[str | None, m.Message]] = []
        self.refusal = ""
        self.mute = False
        self.lock = threading.RLock()

    def feed(self, topic: t.Topic[Any], message: m.Message, robot: str = "robot") -> None:
        """Let `robot` say something."""
        with self.lock:
            for inbox in self._inboxes[topic.key]:
                inbox.put(robot, message)

    def subscribed(self, topic: t.Topic[Any]) -> bool:
        """Return whether somebody listens to `topic`."""
        return bool(self._inboxes[topic.key])

    def publish(self, topic: t.Topic[Any], message: m.Message, robot: str | None = None) -> None:
        super().publish(topic, message, robot)
        if isinstance(message, m.Override):
            self.orders.append((robot or self.robot, message, self.clock.now_ns()))
            if not self.mute:
                self.feed(t.COMMAND_ACK, self._ack(message), robot or self.robot)

    def _ack(self, order: m.Override) -> m.Ack:
        return m.Ack(
            override=order.issued,
            kind=order.kind,
            accepted=not self.refusal,
            reason=self.refusal or "as ordered",
            at=self.stamp(),
        )

    def request(
        self,
        request: t.Request[Any],
        message: m.Message,
        timeout_s: float = 5.0,
        robot: str | None = None,
    ) -> m.Reply:
        self.requests.append((robot, message))
        return m.Reply(accepted=not self.refusal, reason=self.refusal or "done")


def jpeg(sequence: int = 0, width: int = 320, height: int = 180) -> bytes:
    """Return a picture of a grey road through green, with a bar that moves."""
    picture = np.full((height, width, 3), (60, 130, 70), np.uint8)
    picture[: height // 3] = (230, 200, 160)
    road = np.array([[width * 0.45, height / 3], [width * 0.55, height / 3], [width * 0.9, height]])
    road = np.vstack([road, [width * 0.1, height]]).astype(np.int32)
    cv2.fillPoly(picture, [road], (110, 110, 110))
    picture[:, sequence % width] = 255
    return cv2.imencode(".jpg", picture)[1].tobytes()


class Flown:
    """A robot that flies its mission on a fed bus, step by step."""

    def __init__(self, bus: AnsweringBus, name: str = "robot", flight: str = "flight-1") -> None:
        self.bus, self.name, self.flight = bus, name, flight
        self.sequence, self.index, self.count = 0, 0, 0
        self.phase = m.Phase.FOLLOWING
        self.output = m.Output.PIPELINE
        self.model, self.follower = "juncnet", FOLLOWER
        self._say(t.FOLLOWER_ACTIVE, m.ActiveFollower(follower=self.follower))
        self.serve("juncnet")

    def _say(self, topic: t.Topic[Any], message: m.Message) -> None:
        self.bus.feed(topic, message, self.name)

    def serve(self, model: str) -> None:
        """Announce a model."""
        active = m.ActiveModel(
            model=m.ModelIdentity(name=model, sha256="0" * 64),
            classes=("none", "junction"),
            preprocessing="{}",
            preprocessing_hash="0" * 64,
        )
        self._say(t.MODEL_ACTIVE, active)

    def step(self, probability: float = 0.03) -> None:
        """Say all that follows from one picture."""
        self.sequence += 1
        header = m.Stamp(
            epoch=7,
            sequence=self.sequence,
            time_ns=self.bus.clock.now_ns() - 20_000_000,
            clock=self.bus.clock.id,
        )
        image = m.JpegImage.of(jpeg(self.sequence), header=header, width=320, height=180)
        features = np.random.default_rng(self.sequence).random((2, 64, 64), np.float32)
        self._say(t.RADON_FEATURES, m.Features.from_array(features, header, "0" * 64))
        scores = {"none": 1 - probability, "junction": probability}
        self._say(
            t.JUNCTION_SCORE, m.JunctionScore(header=header, model=MODEL, probabilities=scores)
        )
        road = m.RoadSeen(offset_m=0.3, heading_rad=0.05, width_m=6)
        command = m.RoadCommand(
            header=header, source="x", velocity=m.Velocity(), confidence=0.9, road=road
        )
        self._say(t.ROAD_COMMAND, command)
        self._say(t.CAMERA_IMAGE, image)
        self.tell(header, probability)
        if self.sequence % 10 == 1:
            self.report()

    def tell(self, header: m.Stamp | None, smoothed: float) -> None:
        """Tell the state of the navigator and of the vehicle."""
        state = m.NavigationState(
            header=header,
            flight=self.flight,
            phase=self.phase,
            count=self.count,
            mission=MISSION,
            next_turn=None,
            smoothed=smoothed,
            thresholds=THRESHOLDS,
        )
        self._say(t.NAVIGATION_STATE, state)
        angle = self.sequence / 40
        vehicle = m.VehicleState(
            at=self.bus.stamp(),
            capabilities=m.Capabilities(kind="copter"),
            pose=m.Pose(x_m=30 * math.sin(angle), y_m=30 - 30 * math.cos(angle), yaw_rad=angle),
            velocity=m.Velocity(forward_mps=3.0),
            battery=0.8,
            output=self.output,
        )
        self._say(t.VEHICLE_STATE, vehicle)

    def report(self) -> None:
        """Report the health of the six services."""
        for service in t.SERVICES:
            health = m.Health(
                service=service,
                at=self.bus.stamp(),
                flight=self.flight,
                pid=1,
                rate_hz=25,
                age_s=0.03,
                latency_p50_ms=4.2,
                latency_p99_ms=9.9,
            )
            self._say(t.health_topic("*"), health)

    def event(self, kind: m.EventKind, turn: m.Turn | None = None) -> None:
        """Let something happen at the junction that is counted now."""
        event = m.JunctionEvent(
            header=self.bus.stamp(),
            flight=self.flight,
            index=self.index,
            kind=kind,
            count=self.count,
            probability=0.95,
            turn=turn,
        )
        self.index += 1
        self._say(t.JUNCTION_EVENT, event)


class Dashboard:
    """A dashboard over a fed bus; a thread hears it."""

    def __init__(self, board: Board, bus: AnsweringBus, address: Address) -> None:
        self.board, self.bus, self.address = board, bus, address
        self.hearing = threading.Event()
        """While it is set, what is fed is heard."""
        self.hearing.set()
        self._ears = board.listen(bus)
        self._ended = threading.Event()

    def hear(self) -> None:
        """Take what was fed."""
        with self.bus.lock:
            self.board.hear(self._ears)

    def hear_on(self) -> None:
        """Take what is fed, until the end."""
        while not self._ended.wait(0.01):
            if self.hearing.is_set():
                self.hear()

    def end(self) -> None:
        """End `hear_on`."""
        self._ended.set()

    def ask(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Send a request with a key that commands; return status, headers and body.

        Headers are given with `_` for `-`; an empty one is left out.
        """
        fields = {
            "Host": self.address.hosts[0],
            "Authorization": f"Bearer {self.address.command_key}",
            "Content-Type": "application/json" if body is not None else "",
        } | {name.replace("_", "-"): value for name, value in headers.items()}
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        link = http.client.HTTPConnection(HOST, self.address.port, timeout=10)
        with closing(link):
            link.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in fields.items():
                if value:
                    link.putheader(name, value)
            if body is not None:
                link.putheader("Content-Length", str(len(data)))
            link.endheaders(data if body is not None else None)
            answer = link.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()

    def state(self, after: int = 0) -> Any:
        """Return what a page is told."""
        return json.loads(self.ask("GET", f"/state?after={after}")[2])


@contextmanager
def dashboard(view_only: bool = False) -> Generator[Dashboard]:
    """Serve a dashboard over a fed bus."""
    bus = AnsweringBus()
    board = Board(bus.clock, CameraGeometry())
    address = new_address()
    with served(board, address, About("1", view_only, 0.2, 10.0, (FOLLOWER,))):
        shown = Dashboard(board, bus, address)
        thread = threading.Thread(target=shown.hear_on, daemon=True)
        thread.start()
        try:
            yield shown
        finally:
            shown.end()
            thread.join()
