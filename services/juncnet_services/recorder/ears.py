"""Everything that a recorder hears."""

from collections.abc import Iterator
from typing import Any

from juncnet.bus import Bus, Inbox
from juncnet.messages import Message
from juncnet.topics import CAMERA_IMAGE, RADON_FEATURES, TOPICS, Topic, health_topic

CAPACITY = 1000
"""Of each topic: 40 s of 25 Hz."""
UNASKED = (CAMERA_IMAGE, RADON_FEATURES)
"""What costs its sender work or the disk room, and follows from what is recorded anyway."""


class Ears:
    """Subscriptions of all topics of one robot."""

    def __init__(self, bus: Bus, features: bool) -> None:
        topics: list[Topic[Any]] = [t for t in TOPICS if isinstance(t, Topic) and t not in UNASKED]
        topics += [health_topic("*"), *([RADON_FEATURES] if features else [])]
        self._inboxes: list[tuple[Topic[Any], Inbox[Any]]] = [
            (topic, bus.subscribe(topic, CAPACITY)) for topic in topics
        ]

    def heard(self) -> Iterator[tuple[str, Topic[Any], Message]]:
        """Yield what came since the last call, each with its robot."""
        for topic, inbox in self._inboxes:
            for robot, message in inbox.drain():
                named = health_topic(message.service) if topic.key == "health/*" else topic
                yield robot, named, message
