"""A real command_output with a vehicle, flown by a test in the pipeline's and operator's place."""

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import psutil

from juncnet import links
from juncnet.flight import Flight, new_flight
from juncnet.messages import Ack, Override, OverrideKind, VehicleState, Velocity, VelocityCommand
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE, COMMAND_VELOCITY, VEHICLE_STATE
from juncnet.zenoh_bus import ZenohBus

PROCESSES = ("command_output", "junction_navigation")
PERIOD_S = 0.04


def until(condition: Callable[[], bool], what: str, timeout_s: float = 30.0) -> None:
    """Wait for `condition()`; fail with `what` when it does not come."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.005)


class Rig:
    """The process, the bus and the pipeline's commands: `velocity` is sent at 25 Hz, None: none."""

    def __init__(self, layout: str, directory: Path) -> None:
        self.flight: Flight = new_flight("robot", PROCESSES, directory)
        self.layout = directory / "layout.toml"
        head = f"processes = {list(PROCESSES)}\n[launch]\nstate_dir = '{directory}/state'\n"
        self.layout.write_text(head + layout)
        self.bus = ZenohBus(
            links.member(self.flight, PROCESSES[1]), self.flight, PROCESSES[1], directory
        )
        self.states = self.bus.subscribe(VEHICLE_STATE)
        self.acks = self.bus.subscribe(COMMAND_ACK, capacity=64)
        self.velocity: Velocity | None = None
        self.last_sent_s = 0.0
        self.process = self.start()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.command, daemon=True)
        self.thread.start()

    def start(self) -> "subprocess.Popen[bytes]":
        """Start command_output."""
        module = "juncnet_services.command_output"
        where = ["--layout", str(self.layout), "--flight-dir", str(self.flight.directory)]
        return subprocess.Popen([sys.executable, "-m", module, *where], env=dict(os.environ))

    def command(self) -> None:
        """Be the pipeline."""
        while not self.ended.is_set():
            velocity = self.velocity
            if velocity is not None:
                stamp = self.bus.stamp()
                self.last_sent_s = time.monotonic()
                command = VelocityCommand(header=stamp, issued=stamp, velocity=velocity)
                self.bus.publish(COMMAND_VELOCITY, command)
            time.sleep(PERIOD_S)

    def state(self) -> VehicleState | None:
        return self.states.newest

    def order(self, kind: OverrideKind) -> Ack:
        """Be the operator, and return the answer."""
        self.acks.drain()
        issued = self.bus.stamp()
        self.bus.publish(COMMAND_OVERRIDE, Override(issued=issued, kind=kind))
        found: list[Ack] = []

        def answered() -> bool:
            found.extend(a for _, a in self.acks.drain() if a.override == issued)
            return bool(found)

        until(answered, f"no answer to {kind}")
        return found[0]

    def ready(self) -> None:
        """Wait until the vehicle will fly, order the take-off, then resume."""
        until(lambda: self.state() is not None, "no vehicle/state")
        deadline_s = time.monotonic() + 30
        while not (ack := self.order(OverrideKind.TAKE_OFF)).accepted:
            assert time.monotonic() < deadline_s, ack.reason
            time.sleep(0.2)

    def guard(self) -> psutil.Process:
        """Return the guard process."""
        children = psutil.Process(self.process.pid).children()
        return next(c for c in children if any("guard.py" in part for part in c.cmdline()))

    def close(self) -> None:
        self.ended.set()
        self.thread.join(2)
        self.process.kill()
        self.process.wait(5)
        self.bus.close()


@contextmanager
def rig(layout: str) -> Generator[Rig]:
    """Run a rig while the context lasts; guards that linger are ended."""
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        made = Rig(layout, Path(folder))
        try:
            yield made
        finally:
            made.close()
            owner = made.flight.directory / "vehicle-owner"
            owner.write_text("the test has ended")
