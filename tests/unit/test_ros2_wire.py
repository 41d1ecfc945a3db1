"""Twist and TwistStamped byte by byte: by hand, and against pycdr2 where it is installed."""

import importlib
import struct
from dataclasses import make_dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles.ros2_link import DATAGRAM, wish_in
from juncnet_services.command_output.vehicles.ros2_wire import Target, stamped, twist

AHEAD = Velocity(forward_mps=1.0, lateral_mps=-0.5, vertical_mps=0.25, yaw_rate_radps=-2.0)
SPEEDS = st.floats(-20, 20)


def target(transport: Any = "rmw_zenoh", topic: str = "cmd_vel", stamp: bool = False) -> Target:
    return Target(transport, topic, 3, stamp, "juncnet", "base_link")


def test_a_twist_is_52_bytes() -> None:
    expected = bytes((0, 1, 0, 0)) + struct.pack("<6d", 1.0, -0.5, 0.25, 0.0, 0.0, -2.0)
    assert twist(AHEAD) == expected
    assert len(expected) == 52


def test_a_stamped_twist_aligns_its_numbers_behind_the_frames_name() -> None:
    data = stamped(AHEAD, 5_000_000_007, "base_link")
    assert data[:12] == bytes((0, 1, 0, 0)) + struct.pack("<iI", 5, 7)
    assert data[12:26] == struct.pack("<I", 10) + b"base_link\0"
    assert data[26:28] == bytes(2)
    assert data[28:] == twist(AHEAD)[4:]


@given(SPEEDS, SPEEDS, SPEEDS, SPEEDS, st.text("abc_/", max_size=12), st.integers(0, 2**61))
def test_pycdr2_encodes_identically(
    forward: float, left: float, up: float, turn: float, frame: str, time_ns: int
) -> None:
    cdr: Any = pytest.importorskip("pycdr2", reason="the oracle of this test")
    kinds: Any = importlib.import_module("pycdr2.types")

    def struct_of(name: str, *fields: tuple[str, Any]) -> Any:
        return make_dataclass(name, fields, bases=(cdr.IdlStruct,))

    real = kinds.float64
    vector = struct_of("Vector3", ("x", real), ("y", real), ("z", real))
    twist_of = struct_of("Twist", ("linear", vector), ("angular", vector))
    moment = struct_of("Time", ("sec", kinds.int32), ("nanosec", kinds.uint32))
    header = struct_of("Header", ("stamp", moment), ("frame_id", str))
    both = struct_of("TwistStamped", ("header", header), ("twist", twist_of))

    velocity = Velocity(forward_mps=forward, lateral_mps=left, vertical_mps=up, yaw_rate_radps=turn)
    bare = twist_of(vector(forward, left, up), vector(0.0, 0.0, turn))
    assert twist(velocity) == bare.serialize()
    seconds, nanoseconds = divmod(time_ns, 10**9)
    if seconds < 2**31:
        head = header(moment(seconds, nanoseconds), frame)
        assert stamped(velocity, time_ns, frame) == both(head, bare).serialize()


def test_keys_and_tokens_are_those_of_rmw_zenoh() -> None:
    digest = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
    assert target().key == f"3/cmd_vel/geometry_msgs::msg::dds_::Twist_/{digest}"
    node, publisher = target().tokens("abc")
    assert node == "@ros2_lv/3/abc/0/0/NN/%/%/juncnet"
    assert publisher == (
        "@ros2_lv/3/abc/0/1/MP/%/%/juncnet/%cmd_vel/geometry_msgs::msg::dds_::Twist_/"
        f"{digest}/::,10:,:,:,,"
    )
    assert "TwistStamped_/RIHS01_5f0fcd4f" in target(stamp=True).key
    assert target(topic="/robot1/cmd_vel").key.startswith("3/robot1/cmd_vel/")
    assert "/%robot1%cmd_vel/" in target(topic="/robot1/cmd_vel").tokens("abc")[1]


def test_the_bridge_wants_the_topics_name_and_nothing_else() -> None:
    bridge = target("bridge", "/robot1/cmd_vel")
    assert bridge.key == "robot1/cmd_vel"
    assert bridge.tokens("abc") == ()
    assert bridge.attachment(1, 2, bytes(16)) is None


def test_an_attachment_is_number_time_and_who() -> None:
    data = target().attachment(7, 8, bytes(range(16)))
    assert data == struct.pack("<qqB", 7, 8, 16) + bytes(range(16))


@given(st.binary(max_size=60))
def test_any_datagram_of_the_socket_is_a_velocity_or_nothing(data: bytes) -> None:
    wish = wish_in(data)
    if wish is not None:
        assert len(data) == DATAGRAM.size
        assert abs(wish[1].forward_mps) <= 50
