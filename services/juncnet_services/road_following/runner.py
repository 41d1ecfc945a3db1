"""Calls a follower and answers for it: a valid command follows, or the process ends."""

import logging
import os
import signal
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from juncnet.frames import Frame
from juncnet.messages import EventKind, JunctionEvent, RoadCommand, VehicleState
from juncnet_services.road_following.follower import Follower, Proposal

EXIT_CODE = 3
"""Of a process whose follower hung."""
GRACE_S = 1.0
"""After the time limit, until the kernel ends a process whose watchdog cannot run."""
log = logging.getLogger(__name__)


class Watchdog:
    """Ends the process when a `with` block on it takes longer than `limit_s`.

    A thread does it with a log line and exit code 3, which the supervisor answers with a restart.
    Code that hangs without letting other Python threads run is ended by the kernel's alarm
    `GRACE_S` later. `on_hang` is what ends the process; tests bring their own.
    """

    def __init__(
        self, limit_s: float, name: str, on_hang: Callable[[str], None] | None = None
    ) -> None:
        self._limit_s, self._name = limit_s, name
        self._on_hang = on_hang or _end_process
        self._changed = threading.Condition()
        self._deadline: float | None = None
        threading.Thread(target=self._watch, name="follower-watchdog", daemon=True).start()

    def __enter__(self) -> None:
        signal.setitimer(signal.ITIMER_REAL, self._limit_s + GRACE_S)
        with self._changed:
            self._deadline = time.monotonic() + self._limit_s
            self._changed.notify()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._changed:
            self._deadline = None
        signal.setitimer(signal.ITIMER_REAL, 0)

    def _watch(self) -> None:
        with self._changed:
            while True:
                if self._deadline is None:
                    self._changed.wait()
                    continue
                left_s = self._deadline - time.monotonic()
                if left_s > 0:
                    self._changed.wait(left_s)
                    continue
                self._deadline = None
                self._on_hang(
                    f"follower {self._name} hung: a call took longer than time_limit_s = "
                    f"{self._limit_s:g}; the process ends and the supervisor restarts it"
                )


def _end_process(text: str) -> None:
    log.critical(text)
    logging.shutdown()
    os._exit(EXIT_CODE)


class FollowerRunner:
    """A follower behind its watchdog; failures go to `report` and become commands to hold."""

    def __init__(
        self, follower: Follower, source: str, watchdog: Watchdog, report: Callable[[str], None]
    ) -> None:
        self._follower, self._source = follower, source
        self._watchdog, self._report = watchdog, report
        self._turning = False

    def swap(self, follower: Follower) -> None:
        """Ask `follower` from the next picture on. Safe in any thread."""
        self._follower = follower

    def heard(self, event: JunctionEvent) -> None:
        """Take a junction event: during a turn every picture shows a new road."""
        if event.kind in (EventKind.TURN_STARTED, EventKind.TURN_FINISHED):
            self._turning = event.kind is EventKind.TURN_STARTED
            self.reset(f"{event.kind} at junction {event.count}")

    def reset(self, reason: str) -> None:
        """Tell the follower, if it wants to know, that the road ahead is another one."""
        reset: Any = getattr(self._follower, "reset", None)
        if reset is None:
            return
        try:
            with self._watchdog:
                reset(reason)
        except Exception as error:
            self._report(f"follower failed to reset: {type(error).__name__}: {error}")

    def command(self, frame: Frame, state: VehicleState | None) -> RoadCommand:
        """Return the command for `frame`; it has no velocity where the follower fails."""
        if self._turning:
            self.reset("turning")
        try:
            with self._watchdog:
                answer: object = self._follower.follow(frame, state)
            return self._checked(answer, frame)
        except Exception as error:
            self._report(f"follower failed: {type(error).__name__}: {error}")
            return self._hold(frame)

    def _checked(self, answer: object, frame: Frame) -> RoadCommand:
        """Return the command in `answer`; raises where it is nonsense (messages refuse NaN)."""
        if answer is None:
            return self._hold(frame)
        if not isinstance(answer, (Proposal, RoadCommand)):
            raise TypeError(
                f"returned {type(answer).__name__}, not a Proposal, RoadCommand or None"
            )
        return RoadCommand(
            header=frame.header,
            source=self._source,
            velocity=answer.velocity,
            confidence=answer.confidence,
            road=answer.road,
            surface=answer.surface,
        )

    def _hold(self, frame: Frame) -> RoadCommand:
        return RoadCommand(header=frame.header, source=self._source, velocity=None, confidence=0.0)
