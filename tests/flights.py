"""Flights of all processes over real Zenoh, for tests: started, watched and judged."""

import tempfile
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

import pytest

from juncnet.clocks import NS_PER_S
from juncnet.launch import connect
from juncnet.messages import SimulatorTruth
from juncnet.topics import COMMAND_VELOCITY, NAVIGATION_STATE, SIMULATOR_TRUTH, health_topic
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.demo import Demo, Setup
from juncnet_services.cli.judge import MIN_REAL_TIME_FACTOR, Summary
from juncnet_services.cli.local_flights import all_flights, end
from juncnet_services.cli.up import log_end

START_LIMIT_S = 90.0
"""Time allowed for all processes to start on a busy machine."""
ATTEMPTS = 3
"""How often a flight is flown at most while the machine is too slow for the simulation."""
SMALL_CAMERA = ("simulator.width=320", "simulator.height=180")
"""A camera for tests in which flying well does not matter."""
STANDING_MPS = 0.15
"""Below this speed a robot that holds stands still: wind moves it a little."""


def was_stalled(summary: Summary) -> bool:
    """Return whether a flight went wrong, and the simulation was too slow for a second of it."""
    return not summary.flown_right and summary.real_time_factor_lowest < MIN_REAL_TIME_FACTOR


@contextmanager
def flights_folder(monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """Give flights a short folder of their own; what a test leaves running is ended."""
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        try:
            yield Path(folder)
        finally:
            for flight in all_flights():
                end(flight, keep=False)


class Flying:
    """All processes of a flight, and a bus that listens; a context."""

    def __init__(self, setup: Setup, beside: Sequence[str] = ()) -> None:
        self.demo = Demo(setup, beside)
        self.flight = self.demo.flight

    def __enter__(self) -> "Flying":
        self.demo.__enter__()
        try:
            self.bus: ZenohBus = connect(self.flight.directory, timeout_s=START_LIMIT_S)
        except BaseException:
            self.demo.__exit__()
            raise
        self.health = self.bus.subscribe(health_topic("*"), 1000)
        self.errors: dict[str, int] = {}
        """Errors that each process has counted, by its newest report."""
        self.last_errors: dict[str, str] = {}
        self.pids: dict[str, int] = {}
        """Of each process, by its newest report."""
        self.flight_ids: set[str] = set()
        """That the processes say they are part of."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None:
            for process in self.flight.processes:
                print(f"{process}:\n{log_end(self.flight.directory, process)}")
        self.bus.close()
        self.demo.__exit__()
        self.demo.discard()

    def hear(self) -> None:
        """Take the health reports that have come."""
        for _, health in self.health.drain():
            self.errors[health.service] = health.errors
            self.last_errors[health.service] = health.last_error
            self.pids[health.service] = health.pid
            self.flight_ids.add(health.flight)

    def until(self, condition: Callable[[], object], what: str, limit_s: float = 60.0) -> None:
        """Wait until `condition()` holds; fail with `what` after `limit_s`."""
        deadline = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < deadline, f"not within {limit_s:.0f} s: {what}"
            self.bus.wait(0.05)
            self.hear()

    def all_report(self) -> None:
        """Wait until every process has published its health."""
        wanted = set(self.flight.processes)
        self.until(lambda: wanted <= self.pids.keys(), "health of every process", START_LIMIT_S)

    def ended(self) -> list[str]:
        """Return the processes that the supervisor says do not run."""
        states = self.demo.supervisor.status()
        running = {status.name for status in states if status.state == "RUNNING"}
        return [name for name in self.flight.processes if name not in running]

    def moves(self, seconds: float, faster_than_mps: float = 0.5) -> list[SimulatorTruth]:
        """Wait until the robot has moved for `seconds` in a row; return the truth meanwhile."""
        row: list[SimulatorTruth] = []
        truths = self.bus.subscribe(SIMULATOR_TRUTH, 1000)

        def long_enough() -> bool:
            for _, truth in truths.drain():
                if abs(truth.velocity.forward_mps) < faster_than_mps:
                    row.clear()
                row.append(truth)
            return len(row) > 1 and span_s(row) > seconds

        self.until(long_enough, f"the robot moves; {self.why_not()}")
        return row

    def stands(self, seconds: float) -> None:
        """Wait until the robot has stood still for `seconds` in a row."""
        row: list[SimulatorTruth] = []
        truths = self.bus.subscribe(SIMULATOR_TRUTH, 1000)

        def long_enough() -> bool:
            for _, truth in truths.drain():
                if abs(truth.velocity.forward_mps) > STANDING_MPS:
                    row.clear()
                else:
                    row.append(truth)
            return len(row) > 1 and span_s(row) > seconds

        self.until(long_enough, "the robot holds")

    def why_not(self) -> str:
        """Return what the navigator says about the state it is in."""
        state = self.bus.subscribe(NAVIGATION_STATE).take(1.0)
        return "no navigation/state" if state is None else f"{state.phase}: {state.reason}"

    def commands_flow(self, count: int = 25) -> None:
        """Wait for `count` velocity commands that rest on pictures taken from now on."""
        commands, began_ns = self.bus.subscribe(COMMAND_VELOCITY, 1000), self.bus.clock.now_ns()
        fresh: list[int] = []

        def enough() -> bool:
            times = (command.header.time_ns for _, command in commands.drain())
            fresh.extend(ns for ns in times if ns > began_ns)
            return len(fresh) >= count

        self.until(enough, f"{count} commands that rest on new pictures")


def span_s(truths: Sequence[SimulatorTruth]) -> float:
    """Return the time from the first to the last."""
    return (truths[-1].at.time_ns - truths[0].at.time_ns) / NS_PER_S


def limit_s(setup: Setup, patience: float = 2.0) -> float:
    """Return the time that a flight may take, its start on a busy machine included."""
    return START_LIMIT_S + patience * setup.plan.ideal_s


class StallWatch:
    """Knows when this process did not get to run, so that what it timed then is not believed.

    A context; a thread of it sleeps `STEP_S` again and again and notes when that took much longer.
    """

    STEP_S = 0.005
    STALL_S = 0.02

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._stalls_ns: list[tuple[int, int]] = []

    def __enter__(self) -> "StallWatch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def stalled(self, first_ns: int, last_ns: int) -> bool:
        """Return whether this process stalled between two times on the monotonic clock."""
        return any(begin < last_ns and end > first_ns for begin, end in self._stalls_ns)

    def _watch(self) -> None:
        before_ns = time.monotonic_ns()
        while not self._ended.wait(self.STEP_S):
            now_ns = time.monotonic_ns()
            if now_ns - before_ns > self.STALL_S * NS_PER_S:
                self._stalls_ns.append((before_ns, now_ns))
            before_ns = now_ns
