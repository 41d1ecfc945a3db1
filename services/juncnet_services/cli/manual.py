"""`juncnet manual`: flies the robot by keyboard. Who lets go of the keys, stops the robot.

    w s  or  up down      forward, back         space   stop (latched; g: go on)
    a d  or  left right   turn                  g       resume
    q e                   left, right           t       take off
    r f                   up, down              l       land
                                                x, Esc  leave: the robot is stopped first

The pipeline moves nothing meanwhile. Hold a key to move: 0.2 s without one is zero. Terminals wait
before they repeat a held key, so a motion begins with a tap, a pause, and then goes on; shorten the
wait with `xset r rate 200 30`. Leaving, however it comes, stops the robot until `juncnet resume`.
"""

import argparse
import contextlib
import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from types import FrameType

from juncnet.bus import Bus, Inbox
from juncnet.clocks import NS_PER_S
from juncnet.launch import connect
from juncnet.messages import Ack, Override, OverrideKind, Stamp, VehicleState, Velocity
from juncnet.topics import COMMAND_ACK, COMMAND_OVERRIDE, VEHICLE_STATE
from juncnet_services.cli.operator import (
    WhichFlightError,
    add_link_options,
    only_target,
    order,
    verdict,
)
from juncnet_services.cli.stick import Speeds, Stick, key_names

PERIOD_S = 0.05
ORDERS = {
    "space": OverrideKind.HOLD,
    "g": OverrideKind.RESUME,
    "t": OverrideKind.TAKE_OFF,
    "l": OverrideKind.LAND,
}
SILENCE_S = 1.0
STOP_TIMEOUT_S = 3.0
Keys = Callable[[float], list[str]]
"""Waits for up to so many seconds and returns the keys read."""


@dataclass
class Heard:
    """What came back from the vehicle's side."""

    answers: Inbox[Ack]
    states: Inbox[VehicleState]
    sent: dict[tuple[int, int], int] = field(default_factory=dict[tuple[int, int], int])
    """When each unanswered order was sent, by epoch and sequence."""
    answered_ns: int = 0
    trip_ms: float | None = None
    last: str = ""
    state: VehicleState | None = None

    def listen(self, now_ns: int) -> None:
        """Take what has arrived by `now_ns`."""
        for _, ack in self.answers.drain():
            sent_ns = self.sent.pop((ack.override.epoch, ack.override.sequence), None)
            if sent_ns is None:
                continue
            self.trip_ms, self.answered_ns = (now_ns - sent_ns) / 1e6, now_ns
            if ack.kind is not OverrideKind.MANUAL or not ack.accepted:
                self.last = verdict(ack.kind, ack, self.trip_ms / 1e3)
        for _, state in self.states.drain():
            self.state = state
        horizon_ns = now_ns - int(SILENCE_S * NS_PER_S)
        self.sent = {key: ns for key, ns in self.sent.items() if ns > horizon_ns}


def fly(bus: Bus, keys: Keys, stick: Stick, operator: str, show: Callable[[str], None]) -> None:
    """Send what the keys say every `PERIOD_S` until one of them leaves or the bus stops."""
    heard = Heard(bus.subscribe(COMMAND_ACK, capacity=256), bus.subscribe(VEHICLE_STATE))

    def send(kind: OverrideKind, velocity: Velocity | None = None) -> None:
        issued: Stamp = bus.stamp()
        heard.sent[issued.epoch, issued.sequence] = bus.clock.now_ns()
        override = Override(issued=issued, kind=kind, velocity=velocity, operator=operator)
        bus.publish(COMMAND_OVERRIDE, override)

    while bus.running:
        pressed = keys(PERIOD_S)
        now_ns = bus.clock.now_ns()
        for key in pressed:
            if key == "leave":
                return
            if key in ORDERS:
                stick.release()
                send(ORDERS[key])
            else:
                stick.press(key, now_ns)
        velocity = stick.velocity(now_ns)
        send(OverrideKind.MANUAL, velocity)
        heard.listen(now_ns)
        show(status_line(heard, velocity, now_ns))


def status_line(heard: Heard, velocity: Velocity, now_ns: int) -> str:
    """Return what is asked for, what the vehicle does, and how long the last answer took."""
    asked = (
        f"{velocity.forward_mps:+.1f} fwd {velocity.lateral_mps:+.1f} left"
        f" {velocity.vertical_mps:+.1f} up {velocity.yaw_rate_radps:+.1f} yaw"
    )
    if heard.trip_ms is None or now_ns - heard.answered_ns > SILENCE_S * NS_PER_S:
        return f"{asked} | NO ANSWER FROM THE VEHICLE"
    state = heard.state
    doing = "no vehicle/state" if state is None else str(state.output)
    if state is not None and state.battery is not None:
        doing += f", battery {100 * state.battery:.0f} %"
    if state is not None and state.velocity is not None:
        doing += f", {state.velocity.forward_mps:+.1f} m/s"
    return f"{asked} | {doing} | {heard.trip_ms:.0f} ms | {heard.last}"


@contextlib.contextmanager
def raw_terminal(handle: int) -> Generator[Keys]:
    """Read single keys from the terminal `handle` while the context lasts; then as it was."""
    before = termios.tcgetattr(handle)
    tty.setraw(handle)

    def keys(timeout_s: float) -> list[str]:
        ready, _, _ = select.select([handle], [], [], timeout_s)
        if not ready:
            return []
        data = os.read(handle, 1024)
        return key_names(data.decode("latin-1")) if data else ["leave"]

    try:
        yield keys
    finally:
        termios.tcsetattr(handle, termios.TCSADRAIN, before)


def _leave(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _show(text: str) -> None:
    width = os.get_terminal_size(sys.stdout.fileno()).columns
    sys.stdout.write(f"\r\x1b[K{text[: width - 1]}")
    sys.stdout.flush()


def main(argv: list[str]) -> int:
    """Fly until told to leave, then stop the robot; 0 when the vehicle's side confirmed that."""
    parser = argparse.ArgumentParser(
        prog="juncnet manual",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_link_options(parser)
    defaults = Speeds()
    for axis, unit in (
        ("forward", "m/s"),
        ("lateral", "m/s"),
        ("vertical", "m/s"),
        ("yaw", "rad/s"),
    ):
        default: float = getattr(defaults, axis)
        parser.add_argument(f"--{axis}", type=float, default=default, metavar=unit)
    options = parser.parse_args(argv)
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        print("juncnet manual: needs a terminal to read keys from", file=sys.stderr)
        return 2
    stick = Stick(Speeds(options.forward, options.lateral, options.vertical, options.yaw))
    try:
        target = only_target(options.flight, options.robot)
        with connect(target, options.robot, certificates=options.certificates) as bus:
            print((__doc__ or "").partition("\n\n")[2].partition("\n\n")[0])
            for number in (signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, _leave)
            try:
                with (
                    raw_terminal(sys.stdin.fileno()) as keys,
                    contextlib.suppress(KeyboardInterrupt),
                ):
                    fly(bus, keys, stick, options.operator, _show)
            finally:
                ack, took_s = order(bus, OverrideKind.HOLD, options.operator, STOP_TIMEOUT_S)
    except (WhichFlightError, OSError) as error:
        print(f"juncnet manual: {error}", file=sys.stderr)
        return 1
    print(f"\n{verdict('stop', ack, took_s)}")
    return 0 if ack is not None and ack.accepted else 1
