"""geometry_msgs/Twist and TwistStamped as ROS 2 sends them over Zenoh, without ROS: pure.

Payloads are CDR (XCDR1, little-endian): four bytes 0, 1, 0, 0, then fields aligned to their size,
counted from behind those four. Keys, attachments and liveliness tokens are those of rmw_zenoh
(Jazzy and later); zenoh-bridge-ros2dds takes the topic's name as the key, and neither of the
others. Axes are ours: REP 103.
"""

import struct
from dataclasses import dataclass
from typing import Literal

from juncnet.messages import Velocity

ENCAPSULATION = bytes((0, 1, 0, 0))
TYPES = {
    False: (
        "geometry_msgs::msg::dds_::Twist_",
        "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    ),
    True: (
        "geometry_msgs::msg::dds_::TwistStamped_",
        "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    ),
}
"""(type, hash of its definition) of Twist and, True, of TwistStamped."""


@dataclass(frozen=True)
class Target:
    """Who listens: a topic of a ROS 2 domain, behind one of two kinds of router."""

    transport: Literal["rmw_zenoh", "bridge"]
    topic: str
    domain: int
    stamped: bool
    node: str
    frame_id: str

    @property
    def key(self) -> str:
        """Zenoh key of the topic."""
        name = self.topic.strip("/")
        if self.transport == "bridge":
            return name
        kind, digest = TYPES[self.stamped]
        return f"{self.domain}/{name}/{kind}/{digest}"

    def tokens(self, session: str) -> tuple[str, ...]:
        """Return the liveliness tokens by which ROS 2 sees the node and its publisher."""
        if self.transport == "bridge":
            return ()
        kind, digest = TYPES[self.stamped]
        topic = "%" + self.topic.strip("/").replace("/", "%")
        root = f"@ros2_lv/{self.domain}/{session}/0"
        return (
            f"{root}/0/NN/%/%/{self.node}",
            f"{root}/1/MP/%/%/{self.node}/{topic}/{kind}/{digest}/::,10:,:,:,,",
        )

    def payload(self, velocity: Velocity, time_ns: int) -> bytes:
        """Return the message at `time_ns` of the wall clock."""
        return stamped(velocity, time_ns, self.frame_id) if self.stamped else twist(velocity)

    def attachment(self, sequence: int, time_ns: int, gid: bytes) -> bytes | None:
        """Return what rmw_zenoh wants beside a message; `gid`: 16 bytes that name the publisher."""
        if self.transport == "bridge":
            return None
        return struct.pack("<qqB", sequence, time_ns, len(gid)) + gid


def twist(velocity: Velocity) -> bytes:
    """Return geometry_msgs/Twist, 52 bytes: linear x, y, z in m/s, angular x, y, z in rad/s."""
    return ENCAPSULATION + _six(velocity)


def stamped(velocity: Velocity, time_ns: int, frame_id: str) -> bytes:
    """Return geometry_msgs/TwistStamped: time, frame, then the twist."""
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    name = frame_id.encode() + b"\0"
    header = struct.pack("<iII", seconds, nanoseconds, len(name)) + name
    return ENCAPSULATION + header + bytes(-len(header) % 8) + _six(velocity)


def _six(velocity: Velocity) -> bytes:
    return struct.pack(
        "<6d",
        velocity.forward_mps,
        velocity.lateral_mps,
        velocity.vertical_mps,
        0.0,
        0.0,
        velocity.yaw_rate_radps,
    )
