"""`juncnet bench dashboard`: what dashboard and recorder cost a flight, in one flight, by turns.

Without both; with a dashboard that no page looks at; with a page that asks for state and pictures
as often as the browser's does; with a recorder, video included; with that page and the recorder;
with a page that asks and does not read; and while a watched dashboard is killed with -9 again and
again. The conditions take turns within each round, so that all meet the same machine and the same
flight. Frame to command is from a picture's capture to the last command that rests on it, when its
score and its road are both in. Lost are pictures of the camera without a command, or missing in
the recording.
"""

import argparse
import importlib.util
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from juncnet.bus import Bus
from juncnet.launch import connect
from juncnet.layout import SAVED, LayoutError
from juncnet.recording import MISSING
from juncnet.simulation.routes import plan_mission
from juncnet.simulation.towns import random_world
from juncnet.topics import CAMERA_VIDEO, COMMAND_VELOCITY
from juncnet_services.cli.bench.figures import Figure, median, p99, show
from juncnet_services.cli.bench.measured import Listener, cpu_s, flight_cpu_s
from juncnet_services.cli.bench.pipeline import await_commands
from juncnet_services.cli.bench.watching import Page, ask_and_not_read
from juncnet_services.cli.demo import START_S, Demo, Setup, prepare
from juncnet_services.dashboard.access import HOST, Address, address_in

JUNCTIONS = 12
SETTLE_S, KILL_EVERY_S = 1.0, 1.5
STATE_S, PICTURE_S = 0.15, 0.08
"""How often the page asks."""
LATENCY_RATIO = 1.1
WITHOUT, CLOSED, WATCHED, STALLED, KILLED = "without", "closed", "watched", "stalled", "killed"
RECORDED, BOTH = "recorded", "watched and recorded"
CONDITIONS = (WITHOUT, CLOSED, WATCHED, RECORDED, BOTH, STALLED, KILLED)


@dataclass
class Measured:
    """What was measured under one condition, over all rounds."""

    latencies_ms: list[float] = field(default_factory=list[float])
    medians_ms: list[float] = field(default_factory=list[float])
    """Of each round."""
    seconds: float = 0.0
    commanded: int = 0
    lost: int = 0
    recorded: int = 0
    unrecorded: int = 0
    """Pictures between the first and the last in the recording that are not in it."""
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
def repeated(act: Callable[[], object], period_s: float) -> Generator[None]:
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


@contextmanager
def recorded(flight_dir: Path, into: Measured) -> Generator[int]:
    """Record the flight while the context lasts; yields the recorder's process id.

    Raises:
        RuntimeError: nothing is recorded.
    """
    from juncnet.recording.reader import open_recording

    words = (sys.executable, "-m", "juncnet_services.cli", "record", "--connect", str(flight_dir))
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        process = subprocess.Popen((*words, "--out", folder), stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + START_S
        try:
            while not any(Path(folder).glob("*.mcap")):
                if time.monotonic() > deadline or process.poll() is not None:
                    raise RuntimeError("the recorder did not start")
                time.sleep(0.05)
            yield process.pid
        finally:
            process.terminate()
            process.wait(10)
        video = open_recording(Path(folder)).messages([CAMERA_VIDEO.key])
        numbers = {item.message.header.sequence for item in video}
        into.recorded += len(numbers)
        into.unrecorded += missing(numbers)


def missing(numbers: set[int]) -> int:
    """Return how many numbers between the least and the largest are not there."""
    return max(numbers) - min(numbers) + 1 - len(numbers) if numbers else 0


@contextmanager
def condition(name: str, flight_dir: Path, robot: str, into: Measured) -> Generator[dict[str, int]]:
    """Let a condition hold while the context lasts; yields the processes that it adds."""
    pids = dict[str, int]()
    with ExitStack() as stack:
        if name in (RECORDED, BOTH):
            pids["recorder"] = stack.enter_context(recorded(flight_dir, into))
        if name in (CLOSED, WATCHED, BOTH, STALLED, KILLED):
            dashboard = stack.enter_context(Process(flight_dir))
            pids["dashboard"] = dashboard.pid
            page = stack.enter_context(Page(dashboard.address, robot))
            if name is not CLOSED:
                stack.enter_context(repeated(page.ask_picture, PICTURE_S))
            if name in (WATCHED, BOTH, KILLED):
                stack.enter_context(repeated(page.ask_state, STATE_S))
            if name == STALLED:
                stack.enter_context(ask_and_not_read(dashboard.address, robot))
            if name == KILLED:
                stack.enter_context(repeated(dashboard.kill, KILL_EVERY_S))
                del pids["dashboard"]
        yield pids


def measure_one(
    bus: Bus, listener: Listener, demo: Demo, name: str, seconds: float, into: Measured
) -> None:
    """Measure one condition for so long, and add what was found."""
    with condition(name, demo.flight.directory, bus.robot, into) as pids:
        _listen(bus, listener, SETTLE_S)
        used = flight_cpu_s(demo.supervisor) | spent(pids)
        commands, started = bus.subscribe(COMMAND_VELOCITY, 4000), time.monotonic()
        listener.restart()
        _listen(bus, listener, seconds)
        numbers = {command.header.sequence for _, command in commands.drain()}
        into.seconds += time.monotonic() - started
        for process, now_s in (flight_cpu_s(demo.supervisor) | spent(pids)).items():
            into.spend(process, now_s - used.get(process, now_s))
    bus.unsubscribe(commands)
    latencies_ms = listener.latencies.last_ms()
    into.latencies_ms += latencies_ms
    into.medians_ms.append(median(latencies_ms))
    into.commanded += len(numbers)
    into.lost += missing(numbers)


def spent(pids: dict[str, int]) -> dict[str, float]:
    """Return the processor time of processes by name."""
    return {name: cpu_s(pid) for name, pid in pids.items()}


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
        if one.recorded:
            row = f"{name}: pictures missing in the recording"
            rows.append(Figure.against(row, one.unrecorded, "", 0, True, n=one.recorded))
    return rows + cpu_figures(found)


def cpu_figures(found: dict[str, Measured]) -> list[Figure]:
    """Return the CPU of the processes that the conditions concern, per cent of one core."""
    return [
        Figure(
            name=f"{name}: CPU {process}",
            value=100 * one.cpu_s[process] / one.seconds,
            unit="% core",
        )
        for name, one in found.items()
        for process in ("dashboard", "recorder", "frame_capture")
        if process in one.cpu_s
    ]


def a_long_flight(seed: int, settings: Sequence[str]) -> Setup:
    """Return a flight that lasts some minutes.

    Raises:
        ValueError: the world of this seed has no route that is long enough.
    """
    mission = plan_mission(random_world(seed), seed, JUNCTIONS).mission
    return prepare("copter", None, seed, mission, settings)


def rotated(names: Sequence[str], turn: int) -> Iterable[str]:
    """Return the names in their order, beginning with another one each turn."""
    first = turn % len(names)
    return (*names[first:], *names[:first])


def measure(options: argparse.Namespace) -> list[Figure]:
    """Return all figures."""
    demo = Demo(a_long_flight(options.seed, options.set))
    found = {name: Measured() for name in CONDITIONS}
    try:
        with demo, connect(demo.flight.directory, timeout_s=START_S) as bus:
            listener = Listener(bus)
            await_commands(bus, listener)
            for turn in range(options.rounds):
                for name in rotated(CONDITIONS, turn):
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
    if importlib.util.find_spec("mcap") is None:
        print(f"juncnet bench dashboard: {MISSING}", file=sys.stderr)
        return 2
    try:
        found = measure(options)
    except (LayoutError, OSError, ValueError, RuntimeError) as error:
        print(f"juncnet bench dashboard: {error}", file=sys.stderr)
        return 2
    show(found, options.json)
    return 0 if all(figure.reached is not False for figure in found) else 1
