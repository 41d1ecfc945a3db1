"""command_output's end of the guard: starts it, keeps it informed, starts it again if it dies."""

import base64
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from juncnet.clocks import NS_PER_S
from juncnet_services.command_output import guard
from juncnet_services.command_output.vehicles import Hold

OWNER = "vehicle-owner"
PERIOD_S = 0.05
LINGER_S = 10.0
"""How long the guard of a dead command_output holds: longer than a supervisor's restart takes."""
RESTART_S = 0.5


class GuardLink:
    """A running guard for the vehicle whose hold packets are `hold`.

    With its first `hold` it takes the vehicle over from the guard of a dead predecessor in
    `directory`, which holds until then. Leaving it by an exception leaves the guard holding;
    leaving it in order ends the guard. `hold` None: there is nothing to guard, or nothing yet.
    """

    def __init__(self, hold: Hold | None, directory: Path) -> None:
        self.restarts = 0
        self._hold = hold
        self._told = hold
        self._owner = directory / OWNER
        self._token = f"{os.getpid()} {time.time_ns()}"
        self._started_ns = 0
        self._pipe: int | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        if self._hold is not None:
            self._take_over()
            self._start(self._hold)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process is None:
            return
        if kind is None:
            self._write(guard.BYE)
        self._close_pipe()
        if kind is None:
            self._process.wait(5.0)

    @property
    def pid(self) -> int | None:
        """Process id of the guard; None where there is none."""
        return None if self._process is None else self._process.pid

    def beat(self, hold_in_s: float, hold: Hold | None = None) -> None:
        """Have the guard hold in `hold_in_s`, unless it hears from us before; never blocks.

        `hold`: what it shall send from now on, where that has changed; on the same link.
        """
        self._hold = hold or self._hold
        if self._hold is None:
            return
        now_ns = time.monotonic_ns()
        if self._process is None:
            self._take_over()
            self._start(self._hold)
        elif self._process.poll() is not None:
            if now_ns - self._started_ns < RESTART_S * NS_PER_S:
                return
            self.restarts += 1
            self._start(self._hold)
        line: dict[str, object] = {"hold_at_ns": now_ns + int(hold_in_s * NS_PER_S)}
        if self._hold != self._told:
            line |= _packets(self._hold)
        if self._write(json.dumps(line).encode()):
            self._told = self._hold

    def _take_over(self) -> None:
        temporary = self._owner.with_suffix(".new")
        temporary.write_text(self._token)
        temporary.replace(self._owner)

    def _start(self, hold: Hold) -> None:
        order = _packets(hold) | {
            "link": hold.link,
            "owner": str(self._owner.absolute()),
            "token": self._token,
            "period_s": PERIOD_S,
            "linger_s": LINGER_S,
        }
        self._close_pipe()
        self._started_ns = time.monotonic_ns()
        # The order lies in the pipe before the guard runs: it holds even if we die meanwhile.
        reading, self._pipe = os.pipe()
        os.set_blocking(self._pipe, False)
        self._write(json.dumps(order).encode())
        self._told = hold
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, guard.IGNORED)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", guard.__file__],
                stdin=reading,
                stdout=subprocess.DEVNULL,
                pass_fds=(hold.link,),
                start_new_session=True,
                cwd="/",
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
            os.close(reading)

    def _write(self, line: bytes) -> bool:
        """Write a line; when the pipe is full or broken the guard acts on its last deadline."""
        if self._pipe is None:
            return False
        try:
            os.write(self._pipe, line + b"\n")
        except (BlockingIOError, BrokenPipeError):
            return False
        return True

    def _close_pipe(self) -> None:
        if self._pipe is not None:
            os.close(self._pipe)
            self._pipe = None


def _packets(hold: Hold) -> dict[str, object]:
    return {
        "packets": [base64.b64encode(packet).decode() for packet in hold.packets],
        "address": hold.address,
        "step_ns": hold.step_ns,
    }
