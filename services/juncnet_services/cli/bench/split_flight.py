"""A simulated mission flown from another host: both sides started, disturbed, listened to."""

import contextlib
import os
import sys
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

from juncnet.bus import Bus
from juncnet.clocks import NS_PER_S
from juncnet.flight import Flight, read_flight
from juncnet.launch import connect
from juncnet.messages import Health, VelocityCommand
from juncnet.topics import (
    COMMAND_VELOCITY,
    JUNCTION_EVENT,
    JUNCTION_SCORE,
    SIMULATOR_TRUTH,
    VEHICLE_STATE,
    health_topic,
)
from juncnet_services.cli.bench.measured import cpu_s
from juncnet_services.cli.bench.two_hosts import ADDRESS, CLOCK_AHEAD_S, DRONE, LAPTOP, TwoHosts
from juncnet_services.cli.demo import AFTER_FINISH_S, Setup, mission_toml
from juncnet_services.cli.judge import Judge
from juncnet_services.cli.link_tap import LinkTap
from juncnet_services.cli.supervise import Supervisor

PORT, VIDEO_PORT = 7447, 7448
START_S = 120.0
DRONE_SIDE = ("frame_capture", "command_output", "router")
"""What runs on the vehicle's computer; the simulator stands for the vehicle."""
JUNCNET = (sys.executable, "-c", "from juncnet_services.cli.main import main; main()")


@dataclass(frozen=True)
class Heard:
    """A velocity command as it came to the vehicle's host; times in ns on that host's clock."""

    issued_ns: int
    captured_ns: int
    arrived_ns: int

    @property
    def age_ms(self) -> float:
        """From its issue on the laptop to its arrival."""
        return (self.arrived_ns - self.issued_ns) / 1e6

    @property
    def picture_age_ms(self) -> float:
        """From the capture of its picture to its arrival."""
        return (self.arrived_ns - self.captured_ns) / 1e6


@dataclass
class Ears:
    """What is heard on the vehicle's host."""

    bus: Bus
    judge: Judge
    commands: list[Heard] = field(default_factory=list[Heard])
    health: dict[str, Health] = field(default_factory=dict[str, Health])

    def __post_init__(self) -> None:
        self._truths = self.bus.subscribe(SIMULATOR_TRUTH, 1000)
        self._scores = self.bus.subscribe(JUNCTION_SCORE, 1000)
        self._events = self.bus.subscribe(JUNCTION_EVENT, 1000)
        self._commands = self.bus.subscribe(COMMAND_VELOCITY, 1000)
        self._health = self.bus.subscribe(health_topic("*"), 1000)

    def hear(self, timeout_s: float) -> None:
        """Wait for something and take all that has come."""
        self.bus.wait(timeout_s)
        now_ns = self.bus.clock.now_ns()
        for _, command in self._commands.drain():
            self._take(command, now_ns)
        for _, truth in self._truths.drain():
            self.judge.truth(truth)
        for _, score in self._scores.drain():
            self.judge.score(score)
        for _, event in self._events.drain():
            self.judge.event(event)
        for _, health in self._health.drain():
            self.health[f"{health.flight}/{health.service}"] = health

    def _take(self, command: VelocityCommand, now_ns: int) -> None:
        issued = command.issued
        if issued.clock != self.bus.clock.id:
            ns = issued.time_ns - CLOCK_AHEAD_S * NS_PER_S
            issued = replace(issued, time_ns=ns)
        self.commands.append(Heard(issued.time_ns, command.header.time_ns, now_ns))
        self.judge.command(command.model_copy(update={"issued": issued}))


class SplitFlight:
    """Both sides of a flight on two hosts, as a context."""

    def __init__(
        self, hosts: TwoHosts, folder: Path, setup: Setup, size: tuple[int, int], bits_per_s: int
    ) -> None:
        self._hosts, self._folder, self._setup = hosts, folder, setup
        self._size, self._bits_per_s = size, bits_per_s
        self._open = contextlib.ExitStack()
        self.flights: dict[str, Flight] = {}

    def __enter__(self) -> "SplitFlight":
        try:
            self._start(DRONE, "drone_simulated", self._drone())
            self._start(LAPTOP, "laptop", self._laptop())
            bus = self._open.enter_context(connect(self.directory(DRONE), timeout_s=START_S))
            plan, world = self._setup.plan, self._setup.world.name
            self.ears = Ears(bus, Judge(plan, world, self._setup.vehicle))
            self._until_linked(bus)
            self.tap = self._open.enter_context(LinkTap(self.directory(DRONE)))
        except BaseException:
            self._open.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._open.close()

    @staticmethod
    def _until_linked(bus: Bus) -> None:
        """Wait until the vehicle is heard: its link works in both directions then."""
        states, deadline = bus.subscribe(VEHICLE_STATE), time.monotonic() + START_S
        while (state := states.take(0.5)) is None or state.pose is None:
            if time.monotonic() > deadline:
                raise RuntimeError("the simulated vehicle does not answer")
        bus.unsubscribe(states)

    def directory(self, host: str) -> Path:
        """Return the flight's directory of a host."""
        return self.flights[host].directory

    def kill(self, host: str) -> None:
        """Kill every process of a host's side at once, its supervisor first."""
        for pid in self._hosts.pids(host):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, 9)

    def listen(self, seconds: float) -> None:
        """Listen for so long, or until the mission has ended."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0 and not self.ears.judge.finished:
            self.ears.hear(min(left, 0.05))

    def listen_to_the_end(self, limit_s: float) -> None:
        """Listen until the mission has ended and what is judged of its end has happened."""
        self.listen(limit_s)
        deadline = time.monotonic() + AFTER_FINISH_S
        while (left := deadline - time.monotonic()) > 0:
            self.ears.hear(min(left, 0.05))

    def until_moving(self, limit_s: float = 60.0) -> bool:
        """Listen until the pipeline moves the robot; return whether it does."""
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline and not self.ears.judge.finished:
            self.listen(0.5)
            recent = self.tap.told[-5:]
            if len(recent) == 5 and all(not t.holds and t.setpoint.forward_mps > 1 for t in recent):
                return True
        return False

    def drone_cpu_s(self) -> dict[str, float]:
        """Return the processor time that each process of the vehicle's computer has used."""
        status = Supervisor(self.directory(DRONE)).status()
        return {s.name: cpu_s(s.pid) for s in status if s.name in DRONE_SIDE and s.pid}

    @contextlib.contextmanager
    def overload(self, bits_per_s: int) -> Generator[None]:
        """Send more video than the link carries, from the drone to the laptop, meanwhile."""
        log = (self._folder / "overload.log").open("wb")
        module = (sys.executable, "-m", "juncnet_services.cli.bench.video_flood")
        environment = self._environment(DRONE)
        ends = [
            self._hosts.start(
                LAPTOP, [*module, "drain", f"{ADDRESS[DRONE]}:{VIDEO_PORT}"], environment, log
            ),
            self._hosts.start(
                DRONE, [*module, "flood", str(self.directory(DRONE)), str(bits_per_s)],
                environment, log,
            ),
        ]  # fmt: skip
        try:
            yield
        finally:
            for process in ends:
                process.kill()  # unshare(1) takes no other end while its child runs
            for process in ends:
                process.wait(10)
            log.close()

    def _drone(self) -> list[str]:
        width, height = self._size
        return [
            "links.certificates=",
            "links.allow_anyone_on_the_network_to_fly_this_robot=true",
            f"router.port={PORT}",
            f"router.video_port={VIDEO_PORT}",
            f"simulator.width={width}",
            f"simulator.height={height}",
            f"simulator.video.bits_per_s={self._bits_per_s}",
            *self._setup.settings,
        ]

    def _laptop(self) -> list[str]:
        return [
            "links.certificates=",
            "links.allow_anyone_on_the_network_to_fly_this_robot=true",
            f"links.vehicle={ADDRESS[DRONE]}:{PORT}",
            f"links.video={ADDRESS[DRONE]}:{VIDEO_PORT}",
            # Once encoded the simulated camera has little noise: at rest it does repeat itself.
            "frame_capture.frozen_limit=0",
            f"junction_navigation.mission={mission_toml(self._setup.route.mission)}",
        ]

    def _environment(self, host: str) -> dict[str, str]:
        return {"XDG_RUNTIME_DIR": str(self._folder / host)}

    def _start(self, host: str, layout: str, settings: Sequence[str]) -> None:
        home = self._folder / host
        home.mkdir(mode=0o700)
        command = [*JUNCNET, "up", layout, "--timeout", str(START_S)]
        for setting in (*settings, f"launch.state_dir={home}/state"):
            command += ["--set", setting]
        with (home / "up.log").open("wb") as log:
            self._open.callback(self._end, host)
            code = self._hosts.start(host, command, self._environment(host), log).wait(2 * START_S)
        found = list(home.glob("juncnet/*/flight.json"))
        if code or not found:
            raise RuntimeError(f"layout {layout} did not start:\n{(home / 'up.log').read_text()}")
        self.flights[host] = read_flight(found[0].parent)

    def _end(self, host: str) -> None:
        for path in (self._folder / host).glob("juncnet/*/flight.json"):
            Supervisor(path.parent).stop()


def log_tails(folder: Path, lines: int = 15) -> str:
    """Return the last lines of every log of both sides."""
    texts: list[str] = []
    for path in sorted(folder.glob("*/juncnet/*/*.log")):
        texts += [f"--- {path}", *path.read_text(errors="replace").splitlines()[-lines:]]
    return "\n".join(texts)
