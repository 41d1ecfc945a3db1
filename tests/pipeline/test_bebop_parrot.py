"""The Bebop's driver against Parrot's own protocol stack, which plays the drone.

Needs Parrot's wheel in a folder of its own: `pip install parrot-olympe==8.5.0 --no-deps --target
FOLDER`, then `JUNCNET_PARROT=FOLDER`.
"""

import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import Vehicle, open_vehicle

FOLDER = Path(os.environ.get("JUNCNET_PARROT", "/nonexistent"))
pytestmark = pytest.mark.skipif(
    not (FOLDER / "olympe_deps").is_dir(),
    reason="Parrot's stack is not there: JUNCNET_PARROT names its folder (see this file)",
)
PCMD = re.compile(
    r"PCMD \| Flag=(\d) \| Roll=(-?\d+) \| Pitch=(-?\d+) \| Yaw=(-?\d+) \| Gaz=(-?\d+)"
)


class Peer:
    """What Parrot's decoder has printed so far."""

    def __init__(self, directory: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.path = directory / "peer.jsonl"
        places = [str(Path(__file__).parents[1]), str(FOLDER)]
        with self.path.open("w") as out:
            self.process = subprocess.Popen(
                [sys.executable, str(Path(__file__).parents[1] / "parrot_peer.py"), str(self.port)],
                stdout=out,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(places)},
            )

    def lines(self) -> list[dict[str, Any]]:
        whole, _, _ = self.path.read_text().rpartition("\n")
        return [json.loads(line) for line in whole.splitlines()]

    def saw(self, text: str) -> bool:
        return any(text in line["command"] for line in self.lines())

    def pcmds(self, since_ns: int) -> list[tuple[int, tuple[int, ...]]]:
        """Return when each PCMD came and its flag, roll, pitch, yaw, gaz."""
        found = [(line["at_ns"], PCMD.search(line["command"])) for line in self.lines()]
        return [(at, tuple(map(int, m.groups()))) for at, m in found if m and at >= since_ns]


def until(condition: Callable[[], bool], what: str, timeout_s: float = 15.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)


@pytest.fixture
def peer(tmp_path: Path) -> Generator[Peer]:
    made = Peer(tmp_path)
    try:
        until(lambda: made.saw("listening"), "Parrot's stack does not start")
        yield made
    finally:
        made.process.kill()
        made.process.wait(5)


@pytest.fixture
def vehicle(peer: Peer, tmp_path: Path) -> Generator[Vehicle]:
    options = {"address": "127.0.0.1", "discovery_port": peer.port, "events_port": 0}
    made = open_vehicle("bebop", options, tmp_path)
    yield made
    made.close()


def test_parrots_decoder_prints_a_flight_at_20_hz(peer: Peer, vehicle: Vehicle) -> None:
    until(lambda: vehicle.trouble == "", "not connected")
    vehicle.take_off()
    until(lambda: peer.saw("Piloting.TakeOff"), "no take-off")
    until(lambda: (seen := vehicle.telemetry(0.2)) is not None and seen.flying, "does not fly")
    time.sleep(1.5)
    began_ns = time.monotonic_ns()
    for _ in range(100):
        vehicle.send(Velocity(forward_mps=1.0, yaw_rate_radps=0.2), brake=False, lasts_s=0.17)
        time.sleep(0.04)
    seconds = (time.monotonic_ns() - began_ns) / 1e9
    seen = peer.pcmds(began_ns)
    moving = [values for _, values in seen if values[0] == 1]
    assert len(seen) / seconds == pytest.approx(20, abs=1)
    assert len(moving) > 0.8 * len(seen)
    assert max(values[2] for values in moving) > 10
    assert {values[3] for values in moving} == {-11}
    telemetry = vehicle.telemetry(0.2)
    assert telemetry is not None
    assert telemetry.velocity is not None
    assert telemetry.velocity.forward_mps == pytest.approx(1.0, abs=0.3)
    vehicle.land()
    until(lambda: peer.saw("Piloting.Landing"), "no landing")
    assert not peer.saw("Emergency")
    for told in ("AllSettings", "AllStates", "VideoEnable", "REC1080_STREAM480", "Orientation"):
        assert peer.saw(told), told


def test_parrots_stack_accepts_the_packets_of_the_guard_after_ours(
    peer: Peer, vehicle: Vehicle
) -> None:
    until(lambda: vehicle.trouble == "", "not connected")
    time.sleep(0.3)
    hold = vehicle.hold()
    assert hold is not None
    vehicle.close()
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    # The stack's port for commands, which libarsdk fixes.
    link.connect(("127.0.0.1", 2233))
    began_ns = time.monotonic_ns()
    for _ in range(20):
        link.send(hold.packets[time.monotonic_ns() // hold.step_ns % 256])
        time.sleep(0.05)
    link.close()
    until(lambda: len(peer.pcmds(began_ns)) >= 19, "packets were refused", 3.0)


def test_an_emergency_is_parrots_emergency(peer: Peer, vehicle: Vehicle) -> None:
    until(lambda: vehicle.trouble == "", "not connected")
    vehicle.take_off()
    until(lambda: (seen := vehicle.telemetry(0.2)) is not None and seen.flying, "does not fly")
    vehicle.emergency()
    until(lambda: peer.saw("Piloting.Emergency"), "no emergency")
