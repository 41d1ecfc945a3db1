"""Holds the vehicle when command_output cannot: a small process, standard library only.

It has the vehicle's link and ready hold packets. Its standard input is a pipe of lines from
command_output (`guard_link`): first an order (JSON), then deadlines, monotonic nanoseconds of this
host. When a deadline passes without a newer one (command_output hangs or is stopped), or the pipe
closes without `bye` (it died), the guard sends a hold packet every `period_s`, until
- a newer deadline comes,
- a successor has written its own token into the `owner` file, or
- the pipe is closed and `linger_s` are over.
After `bye` it ends at once. Run with `python -I -S guard.py` it uses some 10 MB.
"""

import base64
import itertools
import json
import os
import select
import signal
import socket
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
        ready = [base64.b64decode(str(text)) for text in fields["packets"]]
        self.packets = itertools.cycle(ready)
        """In turn: protocols that number their packets give one for each number."""
        self.address: str | tuple[str, int] | None = fields["address"]
        if isinstance(fields["address"], list):
            self.address = (fields["address"][0], fields["address"][1])
        self.link = socket.socket(fileno=int(fields["link"]))
        self.owner = Path(fields["owner"])
        self.token: str = fields["token"]
        self.period_s: float = fields["period_s"]
        self.linger_s: float = fields["linger_s"]

    def succeeded(self) -> bool:
        """Return whether another command_output has taken the vehicle over."""
        try:
            return self.owner.read_text() != self.token
        except OSError:
            return False

    def hold(self) -> None:
        """Send the next hold packet; a vehicle that is not there is no reason to give up."""
        packet = next(self.packets)
        try:
            if self.address is None:
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
        if came:
            deadline_ns = int(came[-1])
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
