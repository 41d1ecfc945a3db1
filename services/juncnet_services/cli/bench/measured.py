"""What is measured of a flight from outside: latencies by its messages, CPU by /proc."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from juncnet.bus import Bus
from juncnet.clocks import NS_PER_S
from juncnet.messages import Stamp
from juncnet.topics import COMMAND_VELOCITY, JUNCTION_SCORE, ROAD_COMMAND
from juncnet_services.cli.supervise import Supervisor

CAPACITY = 4000
TICKS_HZ = os.sysconf("SC_CLK_TCK")
Key = tuple[int, int]


@dataclass
class Latencies:
    """Collects when the score, the road and the commands of each picture came; times in ns."""

    _scored: dict[Key, int] = field(default_factory=dict[Key, int])
    _seen: dict[Key, int] = field(default_factory=dict[Key, int])
    _commands: dict[Key, list[tuple[int, int]]] = field(
        default_factory=dict[Key, list[tuple[int, int]]]
    )
    TOLERANCE_NS: ClassVar[int] = NS_PER_S // 1000
    """By which the navigator may have heard a message before this process did."""

    def score(self, header: Stamp, now_ns: int) -> None:
        """Note that the score of a picture was heard."""
        self._scored.setdefault((header.epoch, header.sequence), now_ns)

    def road(self, header: Stamp, now_ns: int) -> None:
        """Note that the road of a picture was heard."""
        self._seen.setdefault((header.epoch, header.sequence), now_ns)

    def command(self, header: Stamp, issued_ns: int) -> None:
        """Note a command that rests on a picture."""
        commands = self._commands.setdefault((header.epoch, header.sequence), [])
        commands.append((issued_ns, header.time_ns))

    def complete_ms(self) -> list[float]:
        """Return, a picture, the ms from its capture to a command with its score and its road."""
        found: list[float] = []
        for key, commands in self._commands.items():
            if key not in self._scored or key not in self._seen:
                continue
            ready_ns = max(self._scored[key], self._seen[key]) - self.TOLERANCE_NS
            issued = [pair for pair in commands if pair[0] >= ready_ns]
            if issued:
                found.append((issued[0][0] - issued[0][1]) / 1e6)
        return found

    def last_ms(self) -> list[float]:
        """Return, a picture with score and road, the ms from its capture to its last command.

        That is the one with both in it, whenever this process heard of them.
        """
        both = (key for key in self._commands if key in self._scored and key in self._seen)
        last = (self._commands[key][-1] for key in both)
        return [(issued_ns - captured_ns) / 1e6 for issued_ns, captured_ns in last]

    def first_ms(self) -> list[float]:
        """Return, a picture, the ms from its capture to the first command that rests on it."""
        return [(commands[0][0] - commands[0][1]) / 1e6 for commands in self._commands.values()]

    @property
    def pictures(self) -> tuple[int, int, int]:
        """How many pictures were scored, how many had a road, how many commanded."""
        return len(self._scored), len(self._seen), len(self._commands)


class Listener:
    """Hears what a flight makes of its pictures."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._scores = bus.subscribe(JUNCTION_SCORE, CAPACITY)
        self._roads = bus.subscribe(ROAD_COMMAND, CAPACITY)
        self._commands = bus.subscribe(COMMAND_VELOCITY, CAPACITY)
        self.latencies = Latencies()

    def hear(self) -> None:
        """Take all that has come."""
        now_ns = self._bus.clock.now_ns()
        for _, score in self._scores.drain():
            self.latencies.score(score.header, now_ns)
        for _, road in self._roads.drain():
            self.latencies.road(road.header, now_ns)
        for _, command in self._commands.drain():
            self.latencies.command(command.header, command.issued.time_ns)

    def restart(self) -> None:
        """Forget what came so far."""
        self.hear()
        self.latencies = Latencies()


def children_of(pid: int) -> list[int]:
    """Return the processes that the main thread of a process has started, from /proc."""
    try:
        return [int(c) for c in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def cpu_s(pid: int) -> float:
    """Return the processor time that a process and its living children have used, from /proc."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    own = (int(fields[11]) + int(fields[12])) / TICKS_HZ
    return own + sum(cpu_s(child) for child in children_of(pid))


def flight_cpu_s(supervisor: Supervisor) -> dict[str, float]:
    """Return the processor time that each process of a flight has used, the supervisor's too."""
    own = int((supervisor.directory / "supervisord.pid").read_text())
    times = {status.name: cpu_s(status.pid) for status in supervisor.status() if status.pid}
    return times | {"supervisor": max(0.0, cpu_s(own) - sum(times.values()))}
