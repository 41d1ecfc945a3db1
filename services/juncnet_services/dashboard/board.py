"""What was heard on the buses, behind one lock: filled by one thread, read by those of pages."""

import json
import threading
from collections.abc import Sequence
from typing import Any

from juncnet.bus import Bus, Inbox
from juncnet.camera import CameraGeometry
from juncnet.clocks import NS_PER_S, Clock, Instant
from juncnet.messages import Ack
from juncnet.topics import (
    CAMERA_IMAGE,
    COMMAND_ACK,
    FOLLOWER_ACTIVE,
    JUNCTION_EVENT,
    JUNCTION_SCORE,
    MODEL_ACTIVE,
    NAVIGATION_STATE,
    RADON_FEATURES,
    ROAD_COMMAND,
    VEHICLE_STATE,
    Topic,
    health_topic,
)
from juncnet_services.dashboard.orders import Orders
from juncnet_services.dashboard.robots import Key, Robots
from juncnet_services.dashboard.snapshot import snapshot
from juncnet_services.dashboard.still import still

ALWAYS: tuple[tuple[Topic[Any], int], ...] = (
    (JUNCTION_SCORE, 64),
    (NAVIGATION_STATE, 64),
    (VEHICLE_STATE, 16),
    (JUNCTION_EVENT, 256),
    (COMMAND_ACK, 64),
    (MODEL_ACTIVE, 1),
    (FOLLOWER_ACTIVE, 1),
    (health_topic("*"), 64),
)
"""Topics that are always heard, and how many messages of each robot may wait: they are small."""
WATCHED: tuple[Topic[Any], ...] = (CAMERA_IMAGE, RADON_FEATURES, ROAD_COMMAND)
"""Topics that are heard only while a page shows pictures: JPEGs are made for us alone."""
LOOK_S = 0.05
UNWATCHED_NS = 3 * NS_PER_S
"""Without a page that asks for pictures for so long they are ordered off."""


class Ears:
    """The subscriptions of one bus."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.robots: set[str] = set()
        """Names that were heard on this bus."""
        self._always: list[Inbox[Any]] = [
            bus.subscribe(topic, capacity, robot="*", wakes=topic is COMMAND_ACK)
            for topic, capacity in ALWAYS
        ]
        self._watched: list[Inbox[Any]] = []

    def watch(self, wanted: bool) -> None:
        """Hear pictures and what is found in them, or no longer."""
        if wanted and not self._watched:
            self._watched = [
                self.bus.subscribe(topic, 1 if topic is CAMERA_IMAGE else 4, "*", wakes=False)
                for topic in WATCHED
            ]
        elif not wanted:
            for inbox in self._watched:
                self.bus.unsubscribe(inbox)
            self._watched = []

    def drain(self) -> list[tuple[str, Any]]:
        """Return all that has come, each message with its robot."""
        return [item for inbox in (*self._always, *self._watched) for item in inbox.drain()]


class Board:
    """All robots of all buses, for the pages. `hear` is called again and again, by any thread.

    `only`: names of the robots that are shown and commanded; none: all.
    """

    def __init__(self, clock: Clock, camera: CameraGeometry, only: Sequence[str] = ()) -> None:
        self._clock, self._camera, self._only = clock, camera, frozenset(only)
        self._lock = threading.Lock()
        self._robots = Robots()
        self._ears: list[Ears] = []
        self._asked_ns = -UNWATCHED_NS
        self.orders = Orders(self._bus_of)

    def listen(self, bus: Bus) -> Ears:
        """Begin to listen on a bus; whoever is heard there is commanded through it."""
        ears = Ears(bus)
        self._ears.append(ears)
        return ears

    def hear(self, ears: Ears) -> None:
        """Take what has come on one bus."""
        now_ns = self._clock.now_ns()
        ears.watch(now_ns - self._asked_ns < UNWATCHED_NS)
        with self._lock:
            for robot, message in ears.drain():
                if self._only and robot not in self._only:
                    continue
                ears.robots.add(robot)
                if isinstance(message, Ack):
                    self.orders.heard(message)
                self._robots.take(robot, message, now_ns)

    def still(self, robot: str, after: Key) -> bytes | None:
        """Return a robot's newest picture as `still` makes it; None: there is nothing new."""
        now = self._now()
        self._asked_ns = now.ns
        with self._lock:
            known = self._robots.get(robot)
            return None if known is None else still(known, after, now, self._camera)

    def state(self, after: int, about: dict[str, Any]) -> bytes:
        """Return `about` and the state of all robots, with rows newer than `after`, as JSON."""
        with self._lock:
            return json.dumps(
                about | snapshot(self._robots, after, self._now()), separators=(",", ":")
            ).encode()

    def _now(self) -> Instant:
        return Instant(self._clock.now_ns(), self._clock.id)

    def _bus_of(self, robot: str) -> Bus | None:
        return next((ears.bus for ears in self._ears if robot in ears.robots), None)


def listen(bus: Bus, board: Board) -> None:
    """Hear a bus until it stops."""
    ears = board.listen(bus)
    while bus.running:
        bus.wait(LOOK_S)
        board.hear(ears)
