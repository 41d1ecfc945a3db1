"""Flies a driver in a real command_output, in the pipeline's and the operator's place.

What is done to it: rest, motion, motion beyond all limits, silence, malformed and old commands,
take-off, landing, motor cut; command_output killed, hung, and ended in order. What the driver was
told is in the probe's log; what reached the vehicle is heard where the trial can be the vehicle.
"""

import base64
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from juncnet import links
from juncnet.clocks import NS_PER_S
from juncnet.flight import new_flight
from juncnet.messages import Ack, Override, OverrideKind, Velocity, VelocityCommand
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE, COMMAND_VELOCITY, VEHICLE_STATE
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.command_output.guard_link import OWNER

OUTPUT, PIPELINE = "command_output", "junction_navigation"
PERIOD_S, START_S, END_S = 0.04, 60.0, 8.0
REST_S, FLY_S, SILENCE_S, MOMENT_S = 0.6, 0.8, 0.6, 0.3
AHEAD = Velocity(forward_mps=1.5, yaw_rate_radps=0.3)
WILD = Velocity(forward_mps=50, lateral_mps=-50, vertical_mps=50, yaw_rate_radps=20)
GARBAGE = (b"", b"{", b"null", b"\xff\xfe\x00", b'{"velocity": NaN}', b"[" * 5000)
PROBE = "juncnet_services.kits.vehicle_probe:ProbedVehicle"


@dataclass(frozen=True)
class Part:
    """What was done from `start_ns` to `end_ns`; `last_ns`: the last fresh command, if any."""

    name: str
    start_ns: int
    end_ns: int
    last_ns: int = 0


@dataclass
class Trial:
    """What was seen of a driver; times are monotonic nanoseconds of this host."""

    parts: list[Part] = field(default_factory=list[Part])
    calls: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    """As `kits.vehicle_probe` wrote them."""
    answers: dict[str, Ack] = field(default_factory=dict[str, Ack])
    """To take-off, landing and motor cut."""
    arrived: list[tuple[int, bytes]] | None = None
    """Datagrams at the vehicle; None: the trial was not the vehicle."""
    exit_code: int | None = None
    """Of the end in order; None: it did not end within `END_S`."""
    ended_s: float = 0.0
    late_s: float = 0.0
    """By how much the trial itself was late at most: more is a machine that is too busy."""

    def part(self, name: str) -> Part:
        """Return the part of this name."""
        return next(part for part in self.parts if part.name == name)


class Peer:
    """A UDP socket in the vehicle's place, that keeps what arrives; a context."""

    def __init__(self) -> None:
        self.arrived: list[tuple[int, bytes]] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self.address = f"127.0.0.1:{self._socket.getsockname()[1]}"
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                data = self._socket.recv(65536)
            except OSError:
                continue
            self.arrived.append((time.monotonic_ns(), data))


class Stand:
    """command_output with the probed driver, and the bus on which it is commanded; a context.

    Raises:
        RuntimeError: command_output does not start; the text says what it wrote.
    """

    def __init__(self, driver: str, options: Mapping[str, Any], folder: Path) -> None:
        self.flight = new_flight("robot", (OUTPUT, PIPELINE), folder)
        self.log, self.trial = folder / "calls.jsonl", Trial()
        probed = {"driver": driver, "options": dict(options), "log": str(self.log)}
        layout = {
            "processes": [OUTPUT, PIPELINE],
            "launch": {"state_dir": str(folder / "state")},
            OUTPUT: {"vehicle": PROBE, "options": probed, "loss_latch_s": 60.0},
        }
        self._layout, self._said = folder / "layout.json", folder / "said.txt"
        self._layout.write_text(json.dumps(layout))
        self._bus = ZenohBus(links.member(self.flight, PIPELINE), self.flight, PIPELINE, folder)
        self._states = self._bus.subscribe(VEHICLE_STATE)
        self._acks = self._bus.subscribe(COMMAND_ACK, capacity=64)

    def __enter__(self) -> Self:
        try:
            self.start()
        except RuntimeError:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._bus.close()
        (self.flight.directory / OWNER).write_text("the trial has ended")  # so its guard ends too

    def start(self) -> None:
        """Start command_output, and wait until it speaks."""
        where = ("--layout", str(self._layout), "--flight-dir", str(self.flight.directory))
        path = os.pathsep.join(filter(None, sys.path))
        with self._said.open("ab") as said:
            self.process = subprocess.Popen(
                (sys.executable, "-m", f"juncnet_services.{OUTPUT}", *where),
                env=os.environ | {"PYTHONPATH": path},
                stdout=said,
                stderr=said,
            )
        self._states.drain()
        deadline_s = time.monotonic() + START_S
        while self._states.take(0.05) is None:
            if self.process.poll() is not None or time.monotonic() > deadline_s:
                last = self._said.read_text(errors="replace").strip().splitlines()[-1:]
                raise RuntimeError("command_output did not start: " + "".join(last))

    def during(self, name: str, seconds: float, act: Callable[[], int] | None = None) -> None:
        """Do something every 40 ms for so long; `act` returns when it commanded, 0: it did not."""
        began_ns = time.monotonic_ns()
        end_ns, next_ns, last_ns = began_ns + int(seconds * NS_PER_S), began_ns, 0
        while next_ns < end_ns:
            time.sleep(max(0, next_ns - time.monotonic_ns()) / NS_PER_S)
            self.trial.late_s = max(self.trial.late_s, (time.monotonic_ns() - next_ns) / NS_PER_S)
            last_ns = (act() if act else 0) or last_ns
            next_ns += int(PERIOD_S * NS_PER_S)
        self.trial.parts.append(Part(name, began_ns, time.monotonic_ns(), last_ns))

    def command(self, velocity: Velocity) -> Callable[[], int]:
        """Return an act: command this velocity, as the pipeline does."""

        def act() -> int:
            stamp = self._bus.stamp()
            self._bus.publish(
                COMMAND_VELOCITY, VelocityCommand(header=stamp, issued=stamp, velocity=velocity)
            )
            return time.monotonic_ns()

        return act

    def spoil(self) -> Callable[[], int]:
        """Return an act: send what is malformed, and a command of a second ago, again and again."""
        session: Any = self._bus.session
        key, now = COMMAND_VELOCITY.expression(self._bus.robot), self._bus.stamp()
        old = replace(now, time_ns=now.time_ns - NS_PER_S)
        command = VelocityCommand(header=old, issued=old, velocity=AHEAD)

        def act() -> int:
            for garbage in GARBAGE:
                session.put(key, garbage)
            self._bus.publish(COMMAND_VELOCITY, command)
            return 0

        return act

    def ordered(self, kind: OverrideKind) -> None:
        """Give an operator's order, let it be obeyed for a moment, and resume."""
        began_ns = time.monotonic_ns()
        self._order(kind)
        time.sleep(MOMENT_S)
        self._order(OverrideKind.RESUME)
        self.trial.parts.append(Part(str(kind), began_ns, time.monotonic_ns()))

    def _order(self, kind: OverrideKind) -> None:
        """Give an order, and keep the answer."""
        self._acks.drain()
        issued = self._bus.stamp()
        self._bus.publish(COMMAND_OVERRIDE, Override(issued=issued, kind=kind))
        deadline_s = time.monotonic() + 2.0
        while time.monotonic() < deadline_s:
            for _, ack in self._acks.drain():
                if ack.override == issued:
                    self.trial.answers[str(kind)] = ack
                    return
            time.sleep(0.002)

    def strike(self, name: str, number: signal.Signals) -> None:
        """Send command_output a signal in motion; it is another one afterwards."""
        self.during(f"before {name}", FLY_S, self.command(AHEAD))
        self.process.send_signal(number)
        self.during(name, SILENCE_S)
        self.process.kill()
        self.process.wait()
        self.start()

    def end(self) -> None:
        """End command_output in order."""
        began_s = time.monotonic()
        self.process.terminate()
        try:
            self.trial.exit_code = self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.trial.exit_code = None
        self.trial.ended_s = time.monotonic() - began_s


def fly(driver: str, options: Mapping[str, Any], peer: Peer | None, folder: Path) -> Trial:
    """Return what was seen of the driver; some 10 s. `folder`: empty, for the flight's files.

    Raises:
        RuntimeError: command_output does not start with it.
    """
    with Stand(driver, options, folder) as stand:
        stand.during("rest", REST_S)
        stand.during("motion", FLY_S, stand.command(AHEAD))
        stand.during("wild", FLY_S, stand.command(WILD))
        stand.during("silence", SILENCE_S)
        stand.during("malformed", SILENCE_S, stand.spoil())
        for kind in (OverrideKind.TAKE_OFF, OverrideKind.LAND, OverrideKind.EMERGENCY):
            stand.ordered(kind)
        stand.during("afterwards", FLY_S, stand.command(AHEAD))
        stand.during("rest again", SILENCE_S)
        if peer is not None:
            stand.strike("killed", signal.SIGKILL)
            stand.strike("hung", signal.SIGSTOP)
        stand.during("before the end", FLY_S, stand.command(AHEAD))
        stand.end()
        stand.trial.calls = [json.loads(line) for line in stand.log.read_text().splitlines()]
        stand.trial.arrived = None if peer is None else list(peer.arrived)
        return stand.trial


def hold_packets(calls: list[dict[str, Any]]) -> set[bytes]:
    """Return every packet that the driver ever gave its guard."""
    return {base64.b64decode(text) for call in calls for text in call.get("packets", ())}
