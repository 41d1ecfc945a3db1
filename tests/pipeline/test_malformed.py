"""Malformed payloads on every key of a flight, from a plain Zenoh client: counted, survived."""

import json
import random
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from flights import SMALL_CAMERA, START_LIMIT_S, Flying
from juncnet import topics as t
from juncnet.bus import Inbox
from juncnet.messages import BulkMessage, Message, MessageError, Reply
from juncnet_services.cli.demo import prepare

HUGE_BYTES = 8_000_000
GARBAGE: tuple[bytes, ...] = (
    b"",
    b"\xff\xfe\x00\x01",
    b"{",
    b"null",
    b"[]",
    b"{}",
    b'{"header": NaN}',
    b"[" * 50_000,
    b"\0" * HUGE_BYTES,
    random.Random(1).randbytes(300),
)
HEARD_BY: dict[str, tuple[str, ...]] = {
    "simulator/camera": ("frame_capture",),
    "camera/frame": ("radon_preprocessing", "road_following"),
    "radon/features": ("junction_inference",),
    "model/active": ("radon_preprocessing",),
    "model/load": ("junction_inference",),
    "junction/score": ("junction_navigation",),
    "road/command": ("junction_navigation",),
    "mission/set": ("junction_navigation",),
    "vehicle/state": ("junction_navigation", "road_following"),
    "junction/event": ("road_following",),
    "command/velocity": ("command_output",),
    "command/override": ("command_output",),
}
"""Which services take what comes on a key; all others are taken by this test."""
ANSWER_S = 20.0


def spoilt(fields: dict[str, Any]) -> Iterator[bytes]:
    """Yield what is almost the message with these fields: each time something small is wrong."""
    yield json.dumps(fields | {"surplus": 1}).encode()
    for name in fields:
        yield json.dumps(fields | {name: float("nan")}).encode()
        yield json.dumps(fields | {name: {"wrong": ["shape", 1e400]}}).encode()
    header = fields.get("header")
    if header is not None:
        yield json.dumps(fields | {"header": header | {"sequence": -1}}).encode()
        yield json.dumps(fields | {"header": header | {"clock": "two words"}}).encode()


def samples(heard: Message | None) -> Iterator[tuple[bytes, bytes | None]]:
    """Yield malformed payloads, each with its attachment or None; `heard`: one that is right."""
    for garbage in GARBAGE:
        yield garbage, None
        if heard is None or isinstance(heard, BulkMessage):
            yield b"\xff\xd8", garbage
    if heard is None:
        return
    fields, (payload, attachment) = heard.model_dump(mode="json"), heard.encode()
    if attachment is None:
        yield from ((text, None) for text in spoilt(fields))
        return
    yield from ((payload, text) for text in spoilt(fields))
    yield payload, None
    if "shape" in fields:
        channels, height, width = fields["shape"]
        for wrong in ({"shape": [channels, height, width + 1]}, {"dtype": "<f8"}):
            yield payload, json.dumps(fields | wrong).encode()
        yield payload[:-4], attachment
        yield b"\xff" * len(payload), attachment  # every number in it is NaN


@contextmanager
def outsider(flying: Flying) -> Generator[zenoh.Session]:
    """Open a plain Zenoh session through the flight's router."""
    note = flying.flight.directory / "router.endpoint"
    flying.until(note.exists, "the router listens", START_LIMIT_S)
    settings = {
        "mode": "client",
        "connect": {"endpoints": [f"tcp/{note.read_text().strip()}"]},
        "scouting": {"multicast": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        yield session


class Attack:
    """Sends all that is malformed, and knows how much of it each service must have counted."""

    def __init__(self, session: Any, robot: str) -> None:
        self._session, self._robot = session, robot
        self.sent: dict[str, int] = {}
        """By key."""

    def on(self, topic: Any, heard: Message | None) -> None:
        """Send everything on one key, as messages or, where it takes those, as requests."""
        key = topic.expression(self._robot)
        for payload, attachment in samples(heard):
            self.sent[topic.key] = self.sent.get(topic.key, 0) + 1
            if isinstance(topic, t.Request):
                self._ask(key, payload, attachment)
                continue
            block = zenoh.CongestionControl.BLOCK
            self._session.put(key, payload, attachment=attachment, congestion_control=block)

    def _ask(self, key: str, payload: bytes, attachment: bytes | None) -> None:
        answers = self._session.get(key, payload=payload, attachment=attachment, timeout=ANSWER_S)
        (reply,) = [Reply.decode(answer.ok.payload.to_bytes()) for answer in answers if answer.ok]
        assert not reply.accepted
        assert reply.reason

    def due(self, service: str) -> int:
        """Return how many errors `service` must have counted."""
        return sum(count for key, count in self.sent.items() if service in HEARD_BY.get(key, ()))

    @property
    def due_here(self) -> int:
        """How many this test must have counted."""
        return sum(count for key, count in self.sent.items() if key in messages())


def messages() -> dict[str, t.Topic[Any]]:
    """Return the topics that carry messages, by key."""
    return {topic.key: topic for topic in t.TOPICS if isinstance(topic, t.Topic)}


def counted_here(flying: Flying) -> int:
    """Return the malformed messages that the test's own bus has counted."""
    return flying.bus.health.report(flying.bus.stamp(), "test", 0, 0).errors


def test_rejected_counted_and_survived_on_every_key(folder: Path) -> None:
    assert HEARD_BY.keys() <= {topic.key for topic in t.TOPICS}
    with Flying(prepare("copter", None, 5, None, SMALL_CAMERA)) as flying:
        inboxes: dict[str, Inbox[Any]] = {
            key: flying.bus.subscribe(topic) for key, topic in messages().items()
        }
        flying.all_report()
        flying.commands_flow()
        flying.moves(1.0)
        pids, before = dict(flying.pids), dict(flying.errors)
        with outsider(flying) as session:
            attack = Attack(session, flying.flight.robot)
            for topic in t.TOPICS:
                inbox = inboxes.get(topic.key)
                attack.on(topic, inbox.newest if inbox else None)
            for service in t.SERVICES:
                wanted = before[service] + attack.due(service)
                flying.until(
                    lambda name=service, count=wanted: flying.errors[name] >= count,
                    f"{service} counts {wanted} errors",
                )
            flying.until(lambda: counted_here(flying) >= attack.due_here, "all are counted here")
        assert attack.sent.keys() == {topic.key for topic in t.TOPICS}
        assert all(flying.last_errors[service] for service in t.SERVICES)
        flying.commands_flow()
        flying.moves(1.0)
        assert flying.pids == pids
        assert set(flying.demo.supervisor.restarts().values()) == {0}


def test_no_payload_of_the_attack_is_a_message() -> None:
    for topic in messages().values():
        for payload, attachment in samples(None):
            with pytest.raises(MessageError, match=topic.message.__name__):
                topic.message.decode(payload, attachment)
