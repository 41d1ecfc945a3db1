"""`juncnet bench dashboard`: what a dashboard costs a flight, in one simulated flight, by turns.

Without a dashboard; with one that no page looks at; with a page that asks for state and pictures as
often as the browser's does; with a page that asks and does not read; and while a watched dashboard
is killed with -9 again and again. The conditions take turns within each round, so that all meet the
same machine and the same flight. Frame to command is from a picture's capture to the first
command that its score and its road are both in. Lost are pictures of the camera without a command.
"""

import argparse
import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from pathlib import Path

from juncnet.bus import Bus
from juncnet.launch import connect
from juncnet.layout import SAVED, LayoutError
from juncnet.simulation.routes import plan_mission
from juncnet.simulation.towns import random_world
from juncnet.topics import COMMAND_VELOCITY
from juncnet_services.cli.bench.figures import Figure, median, p99, show
from juncnet_services.cli.bench.measured import Listener, cpu_s, flight_cpu_s
from juncnet_services.cli.bench.pipeline import await_commands
from juncnet_services.cli.demo import START_S, Demo, Setup, prepare
from juncnet_services.dashboard.access import HOST, Address, address_in

JUNCTIONS = 12
SETTLE_S, KILL_EVERY_S = 1.0, 1.5
STATE_S, PICTURE_S = 0.15, 0.08
"""How often the page asks."""
LATENCY_RATIO = 1.1
WITHOUT, CLOSED, WATCHED, STALLED, KILLED = "without", "closed", "watched", "stalled", "killed"
CONDITIONS = (WITHOUT, CLOSED, WATCHED, STALLED, KILLED)


@dataclass
class Measured:
    """What was measured under one condition, over all rounds."""

    latencies_ms: list[float] = field(default_factory=list[float])
    medians_ms: list[float] = field(default_factory=list[float])
    """Of each round."""
    seconds: float = 0.0
    commanded: int = 0
    lost: int = 0
    cpu_s: dict[str, float] = field(default_factory=dict[str, float])

    def spend(self, process: str, seconds: float) -> None:
        """Note processor time."""
        self.cpu_s[process] = self.cpu_s.get(process, 0.0) + seconds


class Process:
    """A dashboard of a flight in a process of its own; a context."""

    def __init__(self, flight_dir: Path) -> None:
        self._command = [
            *(sys.executable, "-m", "juncnet_services.dashboard"),
            *("--layout", str(flight_dir / SAVED), "--flight-dir", str(flight_dir)),
        ]
        self.address: Address = address_in(flight_dir)

    def __enter__(self) -> "Process":
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + START_S
        while not self._answers():
            if time.monotonic() > deadline:
                raise RuntimeError(f"the dashboard did not start in {START_S:.0f} s")
            time.sleep(0.05)
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(10)

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def kill(self) -> None:
        """Kill the process with -9 and start it anew."""
        self._process.kill()
        self._process.wait(10)
        self.__enter__()

    def _answers(self) -> bool:
        try:
            socket.create_connection((HOST, self.address.port), 1).close()
        except OSError:
            return False
        return True


@contextmanager
def repeated(act: Callable[[], None], period_s: float) -> Generator[None]:
    """Do something every `period_s` in a thread while the context lasts."""
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(period_s):
            act()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def look(address: Address, path: str) -> Callable[[], None]:
    """Return a call that asks the dashboard for `path` over one connection, as a page does."""
    link = HTTPConnection(HOST, address.port, timeout=5)

    def ask() -> None:
        try:
            link.request("GET", path, headers={"Authorization": f"Bearer {address.watch_key}"})
            link.getresponse().read()
        except (OSError, HTTPException):  # it was killed
            link.close()

    return ask


def ask_and_not_read(address: Address, path: str) -> socket.socket:
    """Return a connection over which much is asked for and nothing is read."""
    link = socket.create_connection((HOST, address.port))
    link.setblocking(False)
    request = (
        f"GET {path} HTTP/1.1\r\nHost: {address.hosts[0]}\r\n"
        f"Authorization: Bearer {address.watch_key}\r\n\r\n"
    ).encode()
    with contextlib.suppress(BlockingIOError):
        while True:
            link.send(request)
    return link


@contextmanager
def condition(name: str, flight_dir: Path, robot: str) -> Generator[Process | None]:
    """Let a condition hold while the context lasts; yields the dashboard, if there is one."""
    if name == WITHOUT:
        yield None
        return
    state, still = "/state?after=0", f"/still?robot={robot}"
    with ExitStack() as stack:
        dashboard = stack.enter_context(Process(flight_dir))
        if name in (WATCHED, STALLED, KILLED):
            stack.enter_context(repeated(look(dashboard.address, still), PICTURE_S))
        if name in (WATCHED, KILLED):
            stack.enter_context(repeated(look(dashboard.address, state), STATE_S))
        if name == STALLED:
            stack.enter_context(ask_and_not_read(dashboard.address, still))
        if name == KILLED:
            stack.enter_context(repeated(dashboard.kill, KILL_EVERY_S))
        yield dashboard


def measure_one(
    bus: Bus, listener: Listener, demo: Demo, name: str, seconds: float, into: Measured
) -> None:
    """Measure one condition for so long, and add what was found."""
    with condition(name, demo.flight.directory, bus.robot) as dashboard:
        _listen(bus, listener, SETTLE_S)
        used, own = flight_cpu_s(demo.supervisor), cpu_s(dashboard.pid) if dashboard else 0.0
        commands, started = bus.subscribe(COMMAND_VELOCITY, 4000), time.monotonic()
        listener.restart()
        _listen(bus, listener, seconds)
        numbers = {command.header.sequence for _, command in commands.drain()}
        into.seconds += time.monotonic() - started
        for process, now_s in flight_cpu_s(demo.supervisor).items():
            into.spend(process, now_s - used.get(process, now_s))
        if dashboard is not None and name != KILLED:
            into.spend("dashboard", cpu_s(dashboard.pid) - own)
    bus.unsubscribe(commands)
    latencies_ms = listener.latencies.complete_ms()
    into.latencies_ms += latencies_ms
    into.medians_ms.append(median(latencies_ms))
    into.commanded += len(numbers)
    into.lost += max(numbers) - min(numbers) + 1 - len(numbers)


def _listen(bus: Bus, listener: Listener, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while (left_s := until_s - time.monotonic()) > 0:
        bus.wait(min(0.05, left_s))
        listener.hear()


def figures(found: dict[str, Measured]) -> list[Figure]:
    """Return the figures of all conditions.

    Those with a dashboard are held against that without, round by round: what else the machine
    does changes from round to round.
    """
    rows: list[Figure] = []
    for name, one in found.items():
        pairs = zip(one.medians_ms, found[WITHOUT].medians_ms, strict=True)
        ratio = median([with_ms / without_ms for with_ms, without_ms in pairs])
        rows += [
            Figure(
                name=f"{name}: frame to command",
                value=median(one.latencies_ms),
                unit="ms",
                p99=p99(one.latencies_ms),
                n=len(one.latencies_ms),
            ),
            Figure.against(f"{name}: over without", ratio, "times", LATENCY_RATIO, at_most=True),
            Figure(name=f"{name}: commands", value=one.commanded / one.seconds, unit="FPS"),
            Figure.against(f"{name}: pictures lost", one.lost, "", 0, True, n=one.commanded),
        ]
    return rows + cpu_figures(found)


def cpu_figures(found: dict[str, Measured]) -> list[Figure]:
    """Return the CPU of the processes that a dashboard concerns, per cent of one core."""
    return [
        Figure(
            name=f"{name}: CPU {process}",
            value=100 * one.cpu_s[process] / one.seconds,
            unit="% core",
        )
        for name, one in found.items()
        for process in ("dashboard", "frame_capture")
        if process in one.cpu_s
    ]


def a_long_flight(seed: int, settings: Sequence[str]) -> Setup:
    """Return a flight that lasts some minutes.

    Raises:
        ValueError: the world of this seed has no route that is long enough.
    """
    mission = plan_mission(random_world(seed), seed, JUNCTIONS).mission
    return prepare("copter", None, seed, mission, settings)


def measure(options: argparse.Namespace) -> list[Figure]:
    """Return all figures."""
    demo = Demo(a_long_flight(options.seed, options.set))
    found = {name: Measured() for name in CONDITIONS}
    try:
        with demo, connect(demo.flight.directory, timeout_s=START_S) as bus:
            listener = Listener(bus)
            await_commands(bus, listener)
            for turn in range(options.rounds):
                for name in (*CONDITIONS[turn % 5 :], *CONDITIONS[: turn % 5]):
                    measure_one(bus, listener, demo, name, options.seconds, found[name])
                    print(f"round {turn + 1}: {name}", file=sys.stderr, flush=True)
    finally:
        demo.discard()
    return figures(found)


def main(argv: list[str]) -> int:
    """Measure and print; 0 if all targets are reached, 1 if not, 2 if nothing can be measured."""
    parser = argparse.ArgumentParser(
        prog="juncnet bench dashboard",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", action="store_true", help="print a list of figures as JSON")
    parser.add_argument("--seconds", type=float, default=3.0, help="a condition in a round")
    parser.add_argument("--rounds", type=int, default=6, help="of all conditions")
    parser.add_argument("--seed", type=int, default=2, help="of the world flown")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    options = parser.parse_args(argv)
    try:
        found = measure(options)
    except (LayoutError, OSError, ValueError, RuntimeError) as error:
        print(f"juncnet bench dashboard: {error}", file=sys.stderr)
        return 2
    show(found, options.json)
    return 0 if all(figure.reached is not False for figure in found) else 1
