"""The ROS 2 driver and a plain Zenoh subscriber in ROS's place; what is heard when who dies."""

import itertools
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import zenoh

from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import Vehicle, open_vehicle
from juncnet_services.command_output.vehicles.ros2_link import SOCKET, STANDBY

LIMIT_S = 0.2
COMMANDER = """
import sys, time
from pathlib import Path
from juncnet.messages import Velocity
from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.vehicles import open_vehicle

directory = Path(sys.argv[1])
vehicle = open_vehicle("ros2", {"endpoint": sys.argv[2]}, directory)
with GuardLink(vehicle.hold(), directory) as guard:
    print(guard.pid, flush=True)
    while True:
        vehicle.send(Velocity(forward_mps=1.0), False, 0.17)
        guard.beat(0.17, vehicle.hold())
        vehicle.telemetry(0.2)
        time.sleep(0.04)
"""
"""Accepts a command and sends it every 40 ms, as command_output does."""


class Ros:
    """A router as rmw_zenohd is one, and what was published through it."""

    def __init__(self, expression: str) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        settings = {
            "mode": "router",
            "listen": {"endpoints": [self.endpoint]},
            "scouting": {"multicast": {"enabled": False}},
        }
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
        self.heard: list[tuple[float, str, bytes, bytes | None]] = []
        self.session.declare_subscriber(expression, self.hear)

    def hear(self, sample: zenoh.Sample) -> None:
        extra = None if sample.attachment is None else sample.attachment.to_bytes()
        item = (time.monotonic(), str(sample.key_expr), sample.payload.to_bytes(), extra)
        self.heard.append(item)

    def forward(self) -> list[tuple[float, float]]:
        """Return when what forward speed was heard."""
        return [(t, struct.unpack_from("<d", p, 4)[0]) for t, _, p, _ in list(self.heard)]

    def tokens(self) -> set[str]:
        found = self.session.liveliness().get("@ros2_lv/**", timeout=2)
        return {str(t.ok.key_expr) for t in found if t.ok is not None}


@contextmanager
def ros(expression: str) -> Generator[Ros]:
    made = Ros(expression)
    try:
        yield made
    finally:
        made.session.close()  # type: ignore[no-untyped-call]


@contextmanager
def driving(made: Ros, directory: Path, **options: Any) -> Generator[Vehicle]:
    vehicle = open_vehicle("ros2", {"endpoint": made.endpoint} | options, directory)
    try:
        yield vehicle
    finally:
        vehicle.close()


def until(condition: Callable[[], bool], what: str, timeout_s: float = 20.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.005)


def drive(vehicle: Vehicle, condition: Callable[[], bool], what: str) -> None:
    """Command as command_output does until `condition()`."""
    deadline_s = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline_s, what
        vehicle.send(Velocity(forward_mps=1.0, yaw_rate_radps=0.5), brake=False, lasts_s=0.17)
        vehicle.telemetry(0.2)
        time.sleep(0.04)


def first_stop_s(made: Ros) -> float:
    """Return the seconds between the last forward velocity heard and the first zero after it."""
    until(lambda: bool(made.heard) and made.forward()[-1][1] == 0, "no zero velocity")
    seen = made.forward()
    last = max(i for i, (_, speed) in enumerate(seen) if speed > 0)
    return seen[last + 1][0] - seen[last][0]


def test_a_twist_reaches_rmw_zenoh_with_attachment_and_tokens(tmp_path: Path) -> None:
    with ros("0/cmd_vel/**") as made:
        with driving(made, tmp_path) as vehicle:
            drive(vehicle, lambda: len(made.forward()) > 20, "nothing was heard")
            drive(vehicle, lambda: vehicle.trouble == "", vehicle.trouble)
            heard = list(made.heard)
            _, key, payload, attachment = heard[-1]
            assert key.startswith("0/cmd_vel/geometry_msgs::msg::dds_::Twist_/RIHS01_9c45bf16")
            expected = struct.pack("<4B6d", 0, 1, 0, 0, 1.0, 0, 0, 0, 0, 0.5)
            assert payload == expected
            assert attachment is not None
            number, _, length = struct.unpack_from("<qqB", attachment)
            assert (length, len(attachment)) == (16, 33)
            assert number >= len(heard) > 20
            assert {t.split("/")[5] for t in made.tokens()} == {"NN", "MP"}
        assert made.forward()[-1][1] == 0
    assert not list(tmp_path.glob("ros2-client-*"))


def test_a_stamped_twist_reaches_the_bridge(tmp_path: Path) -> None:
    with (
        ros("robot1/cmd_vel") as made,
        driving(
            made, tmp_path, transport="bridge", topic="/robot1/cmd_vel", stamped=True
        ) as vehicle,
    ):
        drive(vehicle, lambda: len(made.heard) > 3, "nothing was heard")
        _, key, payload, attachment = made.heard[-1]
        assert (key, attachment, len(payload)) == ("robot1/cmd_vel", None, 76)
        seconds = struct.unpack_from("<i", payload, 4)[0]
        assert abs(seconds - time.time()) < 5
        assert struct.unpack_from("<6d", payload, 28) == (1.0, 0, 0, 0, 0, 0.5)


@contextmanager
def commander(made: Ros, directory: Path) -> Generator[tuple[psutil.Process, psutil.Process]]:
    """Run a command_output's worth of driver and guard; yields both."""
    process = subprocess.Popen(
        [sys.executable, "-c", COMMANDER, str(directory), made.endpoint],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    guard = psutil.Process(int(process.stdout.readline()))
    try:
        until(lambda: len(made.heard) > 10, "nothing was heard")
        yield psutil.Process(process.pid), guard
    finally:
        process.kill()
        if guard.is_running():
            guard.kill()
        bye = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        for name in (STANDBY, SOCKET):
            with suppress(OSError):
                bye.sendto(b"bye", str(directory / name))
        bye.close()
        process.communicate()


@pytest.mark.parametrize("dies", ["command_output", "both"])
def test_the_robot_is_stopped_in_time_when_commander_or_guard_too_are_killed(
    tmp_path: Path, dies: str
) -> None:
    with ros("0/cmd_vel/**") as made, commander(made, tmp_path) as (process, guard):
        if dies == "both":
            guard.send_signal(signal.SIGKILL)
        os.kill(process.pid, signal.SIGKILL)
        assert first_stop_s(made) < LIMIT_S
        since = len(made.heard)
        until(lambda: len(made.heard) >= since + 5, "zero is not repeated")
        assert all(speed == 0 for _, speed in made.forward()[since:])


def links_of(parent: psutil.Process) -> list[psutil.Process]:
    """Return the link processes, the speaker first."""
    found = [c for c in parent.children() if c.status() != psutil.STATUS_ZOMBIE]
    found = [c for c in found if any("ros2_link" in part for part in c.cmdline())]
    return sorted(found, key=lambda c: c.create_time())


@pytest.mark.parametrize(
    ("blow", "limit_s"),
    [(signal.SIGKILL, LIMIT_S), pytest.param(signal.SIGSTOP, 1.0, marks=pytest.mark.full)],
)
def test_the_standby_takes_over_from_a_dead_or_hung_link_process(
    tmp_path: Path, blow: int, limit_s: float
) -> None:
    with ros("0/cmd_vel/**") as made, driving(made, tmp_path) as vehicle:
        own = psutil.Process()
        drive(vehicle, lambda: len(made.heard) > 3 and len(links_of(own)) == 2, "no standby")
        standby = tmp_path / STANDBY
        drive(vehicle, standby.exists, "no standby")
        drive(vehicle, lambda: vehicle.trouble == "", vehicle.trouble)
        speaker, _ = links_of(own)
        speaker.send_signal(blow)
        last_s = made.forward()[-1][0]
        before = len(made.heard)
        drive(vehicle, lambda: len(made.heard) > before + 5, "nobody took over")
        times = [t for t, _ in made.forward() if t >= last_s]
        assert max(b - a for a, b in itertools.pairwise(times)) < limit_s
        drive(vehicle, lambda: len(links_of(own)) == 2 and standby.exists(), "no new standby")


def test_the_standby_stops_the_robot_when_all_others_are_killed_at_once(tmp_path: Path) -> None:
    with ros("0/cmd_vel/**") as made, commander(made, tmp_path) as (process, guard):
        until((tmp_path / STANDBY).exists, "no standby")
        time.sleep(0.5)
        speaker = links_of(process)[0]
        for victim in (guard, speaker, process):
            victim.send_signal(signal.SIGKILL)
        assert first_stop_s(made) < LIMIT_S


def test_no_router_is_named(tmp_path: Path) -> None:
    vehicle = open_vehicle("ros2", {"endpoint": "tcp/127.0.0.1:1"}, tmp_path)
    drive(vehicle, lambda: "no Zenoh router" in vehicle.trouble, vehicle.trouble)
    vehicle.close()
