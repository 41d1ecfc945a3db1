"""Holds the vehicle when command_output cannot: a small process, standard library only.

It has the vehicle's link and ready hold packets. Its standard input is a pipe of JSON lines from
command_output (`guard_link`): first an order, then deadlines (`hold_at_ns`, monotonic nanoseconds
of this host), with new packets where those have changed. When a deadline passes without a newer
one (command_output hangs or is stopped), or the pipe closes without `bye` (it died), the guard
sends a hold packet every `period_s`, until
- a newer deadline comes,
- a successor has written its own token into the `owner` file, or
- the pipe is closed and `linger_s` are over.
After `bye` it ends at once. Run with `python -I -S guard.py` it uses some 10 MB.
"""

import base64
import json
import os
import select
import signal
import socket
import stat
import time
from pathlib import Path
from typing import Any

BYE = b"bye"
IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end command_output, and the guard only through it."""
NS_PER_S = 1_000_000_000


class Order:
    """What command_output hands over at the start."""

    def __init__(self, line: bytes) -> None:
        fields: dict[str, Any] = json.loads(line)
        self.packets: list[bytes] = []
        self.address: str | tuple[str, int] | None = None
        self.step_ns = 0
        self.sent = 0
        self.take(fields)
        self.port = int(fields["link"])
        is_socket = stat.S_ISSOCK(os.fstat(self.port).st_mode)
        self.link = socket.socket(fileno=self.port) if is_socket else None
        self.owner = Path(fields["owner"])
        self.token: str = fields["token"]
        self.period_s: float = fields["period_s"]
        self.linger_s: float = fields["linger_s"]

    def take(self, fields: dict[str, Any]) -> None:
        """Send the packets in `fields`, if there are any, to the address there from now on."""
        if "packets" not in fields:
            return
        self.packets = [base64.b64decode(str(text)) for text in fields["packets"]]
        address: Any = fields["address"]
        self.address = (address[0], address[1]) if isinstance(address, list) else address
        self.step_ns = int(fields["step_ns"])

    def next(self) -> bytes:
        """Return the next hold packet: in turn, or the one that its number makes it the turn of."""
        number = time.monotonic_ns() // self.step_ns if self.step_ns else self.sent
        self.sent += 1
        return self.packets[number % len(self.packets)]

    def succeeded(self) -> bool:
        """Return whether another command_output has taken the vehicle over."""
        try:
            return self.owner.read_text() != self.token
        except OSError:
            return False

    def hold(self) -> None:
        """Send the next hold packet; a vehicle that is not there is no reason to give up."""
        packet = self.next()
        try:
            if self.link is None:
                os.write(self.port, packet)
            elif self.address is None:
                self.link.send(packet)
            else:
                self.link.sendto(packet, self.address)
        except OSError:
            return


class Lines:
    """Lines of the pipe `handle`; what is incomplete waits for the rest."""

    def __init__(self, handle: int) -> None:
        self.handle = handle
        self.open = True
        self._rest = b""

    def read(self, timeout_s: float) -> list[bytes]:
        """Return what came within `timeout_s`: at once when there is something or the end."""
        if not select.select([self.handle], [], [], max(0.0, timeout_s))[0]:
            return []
        data = os.read(self.handle, 65536)
        self.open = bool(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines


def first_line(lines: Lines) -> tuple[bytes | None, list[bytes]]:
    """Return the first line and those that came with it; None when the pipe closed before."""
    while lines.open:
        came = lines.read(60.0)
        if came:
            return came[0], came[1:]
    return None, []


def watch(order: Order, lines: Lines, came: list[bytes]) -> None:
    """Return after `bye`, or when the pipe is closed and the vehicle no longer ours to hold."""
    deadline_ns = time.monotonic_ns()
    if not came:
        came = lines.read(60.0)
    while lines.open:
        if BYE in came:
            return
        for line in came:
            fields: dict[str, Any] = json.loads(line)
            order.take(fields)
            deadline_ns = int(fields["hold_at_ns"])
        late_ns = time.monotonic_ns() - deadline_ns
        if late_ns >= 0:
            order.hold()
        came = lines.read(order.period_s if late_ns >= 0 else -late_ns / NS_PER_S)
    end_ns = time.monotonic_ns() + int(order.linger_s * NS_PER_S)
    while time.monotonic_ns() < end_ns and not order.succeeded():
        order.hold()
        time.sleep(order.period_s)


def hurry() -> None:
    """Run before others on a busy machine, where that is allowed (CAP_SYS_NICE or LimitRTPRIO)."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except (AttributeError, OSError):
        return


def main() -> None:
    """Guard until there is nothing left to guard."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    hurry()
    lines = Lines(0)
    line, came = first_line(lines)
    if line is not None:
        watch(Order(line), lines, came)


if __name__ == "__main__":
    main()
