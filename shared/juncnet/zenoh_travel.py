"""How each kind of topic travels over a Zenoh session: priorities, drops, what late joiners get."""

from collections.abc import Callable
from typing import Any

import zenoh
from zenoh import ext

from juncnet.topics import Qos, Topic

PRIORITIES = {
    Qos.COMMAND: zenoh.Priority.REAL_TIME,
    Qos.FLIGHT: zenoh.Priority.INTERACTIVE_HIGH,
    Qos.EVENT: zenoh.Priority.DATA_HIGH,
    Qos.KEPT: zenoh.Priority.DATA_HIGH,
    Qos.BULK: zenoh.Priority.BACKGROUND,
}
KEEP = {Qos.EVENT: 256, Qos.KEPT: 1}
"""How many samples late joiners get."""
HEARTBEAT_S = 0.5
"""How soon a missed last event is noticed."""


def declare_publisher(session: zenoh.Session, topic: Topic[Any], key: str) -> Any:
    """Return a publisher of `topic` under `key` that never blocks for long: it drops instead."""
    travel: dict[str, Any] = {
        "encoding": topic.message.encoding(),
        "priority": PRIORITIES[topic.qos],
        "congestion_control": zenoh.CongestionControl.DROP,
        "express": topic.qos is not Qos.BULK,
    }
    if topic.qos not in KEEP:
        return session.declare_publisher(key, **travel)
    return ext.declare_advanced_publisher(
        session,
        key,
        **travel,
        cache=ext.CacheConfig(KEEP[topic.qos]),
        sample_miss_detection=ext.MissDetectionConfig(
            heartbeat=HEARTBEAT_S, sporadic_heartbeat=None
        ),
        publisher_detection=True,
    )


def declare_subscriber(
    session: zenoh.Session, topic: Topic[Any], key: str, received: Callable[[zenoh.Sample], None]
) -> Any:
    """Return a subscriber of `topic` under `key` that calls `received` in a thread of Zenoh's."""
    if topic.qos not in KEEP:
        return session.declare_subscriber(key, received)
    return ext.declare_advanced_subscriber(
        session,
        key,
        received,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=KEEP[topic.qos]),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )
